"""Export a skill for other programs: MATLAB's SEDS tools, JSON, NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.store import Lock, write_file
from skillctl.store.exports import EXPORT_FORMATS
from skillctl.store.source import open_skill


@dataclass(frozen=True)
class ExportReport:
    """What was written.

    Attributes:
        skill, digest: The skill, and its content digest.
        path: The file.
        leaf: Which leaf was written, counted from 1; None for the whole skill.
        variables: Names in the file.
    """

    skill: str
    digest: str
    path: Path
    leaf: int | None
    variables: tuple[str, ...]


def export(
    reference: str | Path,
    output: Path,
    *,
    leaf: int | None = None,
    store: Path | None = None,
    lock: Lock | None = None,
) -> ExportReport:
    """Write a skill in a format that other programs read, chosen by the file's ending.

    ``.mat``: one SEDS skill in the layout of the MATLAB tools of its authors: ``Priors`` (1, K), ``Mu``
    (2d, K) and ``Sigma`` (2d, 2d, K) of the joint mixture of [ξ − ξ*; ξ̇], so the target is the origin;
    ``attractor`` (d, 1) says where it was. ``.json``, ``.npz``: all arrays of the artifact, its metadata.

    Args:
        reference: The skill.
        output: The file; replaced if it exists.
        leaf: For ``.mat``, which leaf of the skill, counted from 1; not needed if there is one.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        UsageError: Another ending, several leaves where one is needed, or a leaf in learned coordinates for
            ``.mat``, which has no place for them.
        NotFoundError, ArtifactError: The reference leads to no intact skill.
        StoreError: The file cannot be written.
    """
    formats = {each.suffix: each for each in EXPORT_FORMATS}
    if output.suffix not in formats:
        *most, last = formats
        raise UsageError(
            f"{output}: skills are exported as {', '.join(most)} or {last}; the ending of the file decides.",
            hint=f"Name a file with one of these endings, as in -o {output.stem or 'skill'}.json.",
        )
    chosen = formats[output.suffix]
    if leaf is not None and not chosen.one_leaf:
        raise UsageError("--leaf is for .mat files.", hint="Other files hold all leaves.")
    source = open_skill(reference, store, lock)
    if chosen.one_leaf:
        leaf = _only_leaf(source.skill.leaves, leaf)
    variables, data = chosen.encode(source.artifact, source.skill.leaves[(leaf or 1) - 1])
    write_file(output, data)
    return ExportReport(source.name, source.artifact.digest, output, leaf, variables)


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
