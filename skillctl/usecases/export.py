"""Export a skill for other programs: a header in C99, MATLAB's SEDS tools, JSON, NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.codegen.check import Check
from skillctl.codegen.header import names_of
from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.store import Lock, write_file
from skillctl.store.exports import EXPORT_FORMATS
from skillctl.store.source import Source, open_skill
from skillctl.usecases import c99

C99 = "c99"


@dataclass(frozen=True)
class ExportReport:
    """What was written.

    Attributes:
        skill, digest: The skill, and its content digest.
        path: The file; not written if ``check`` has a problem.
        leaf: Which leaf was written, counted from 1; None for the whole skill.
        variables: Names in the file.
        check: How a header compares with the skill; None if that was not asked.
    """

    skill: str
    digest: str
    path: Path
    leaf: int | None
    variables: tuple[str, ...]
    check: Check | None = None


def export(
    reference: str | Path,
    output: Path,
    *,
    leaf: int | None = None,
    form: str | None = None,
    check: bool = False,
    store: Path | None = None,
    lock: Lock | None = None,
) -> ExportReport:
    """Write a skill in a format that other programs read, by default chosen by the file's ending.

    ``.mat``: one SEDS skill in the layout of the MATLAB tools of its authors: ``Priors`` (1, K), ``Mu``
    (2d, K) and ``Sigma`` (2d, 2d, K) of the joint mixture of [ξ − ξ*; ξ̇], so the target is the origin;
    ``attractor`` (d, 1) says where it was. ``.json``, ``.npz``: all arrays of the artifact, its metadata.
    ``.h``: the controller of the skill in C99.

    Args:
        reference: The skill.
        output: The file; replaced if it exists.
        leaf: For ``.mat``, which leaf of the skill, counted from 1; not needed if there is one.
        form: ``c99``, ``mat``, ``json`` or ``npz``, whatever the ending.
        check: Compile a header and compare it with the skill before it is written.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        UsageError: Another ending, several leaves where one is needed, or a leaf in learned coordinates for
            ``.mat``, which has no place for them.
        NotFoundError, ArtifactError: The reference leads to no intact skill.
        StoreError: The file cannot be written.
    """
    form = form or {c99.SUFFIX: C99}.get(output.suffix, output.suffix.removeprefix("."))
    formats = {each.suffix.removeprefix("."): each for each in EXPORT_FORMATS}
    if check and form != C99:
        raise UsageError("--check is for headers in C99.", hint="Add --format c99, or name a file FILE.h.")
    if form == C99 and leaf is None:
        return _export_c99(open_skill(reference, store, lock), output, check)
    if form not in (*formats, C99):
        endings = ", ".join(each.suffix for each in EXPORT_FORMATS)
        raise UsageError(
            f"{output}: skills are exported as {endings} or {c99.SUFFIX}; the ending of the file decides.",
            hint=f"Name a file with one of these endings, as in -o {output.stem or 'skill'}.json.",
        )
    chosen = formats.get(form)
    if chosen is None or (leaf is not None and not chosen.one_leaf):
        raise UsageError("--leaf is for .mat files.", hint="Other files hold all leaves.")
    source = open_skill(reference, store, lock)
    if chosen.one_leaf:
        leaf = _only_leaf(source.skill.leaves, leaf)
    variables, data = chosen.encode(source.artifact, source.skill.leaves[(leaf or 1) - 1])
    write_file(output, data)
    return ExportReport(source.name, source.artifact.digest, output, leaf, variables)


def _export_c99(source: Source, output: Path, check: bool) -> ExportReport:
    """Write a skill as a header; if it is to be checked, only where it commands the same."""
    header, facts = c99.c99_of(source)
    found = c99.checked(source, header, facts) if check else None
    if found is None or not found.problem:
        write_file(output, header.encode("ascii"))
    names = names_of(source.skill, facts)
    return ExportReport(source.name, source.artifact.digest, output, None, names, found)


def _only_leaf(leaves: tuple[SedsSkill, ...], leaf: int | None) -> int:
    if leaf is None and len(leaves) == 1:
        return 1
    if leaf is None or not 1 <= leaf <= len(leaves):
        raise UsageError(
            f"a .mat file holds one mixture, and this skill has {len(leaves)}"
            + (f", so there is no leaf {leaf}." if leaf is not None else "."),
            hint=f"Choose one with --leaf 1 to {len(leaves)}, or write .json or .npz.",
        )
    return leaf
