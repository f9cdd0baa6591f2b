"""What a build tool such as Make needs to know of a file that was made."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from skillctl.errors import StoreError, UsageError
from skillctl.store import (
    Artifact,
    Operation,
    ParentRecord,
    current_provenance,
    input_fingerprint,
    write_file,
)

# The option that says, in one digest, which skills there were to choose from.
CANDIDATES = "candidates"


def require_target(output: Path | None, depfile: Path | None, if_changed: bool) -> None:
    """Raise UsageError if a build tool's options are given without a file that they can be about."""
    if output is None and (depfile is not None or if_changed):
        raise UsageError(
            f"{'--depfile' if depfile else '--if-changed'} is about a file, and none is written.",
            hint="Give -o FILE.h5; versions in the store never change.",
        )


def finish_target(
    output: Path | None,
    inputs: Iterable[Path],
    *,
    created: bool,
    depfile: Path | None = None,
    if_changed: bool = False,
) -> None:
    """Leave a target as a build tool wants it: newer than its inputs, its dependencies written down.

    Args:
        output: The file that was made, or found to be right already; None for a version of the store.
        inputs: Files it was made from.
        created: Whether it was written.
        depfile: File for the dependencies, in Make's syntax.
        if_changed: Leave the time of an unchanged target alone, so that nothing after it is made again.
    """
    if output is None:
        return
    if not created and not if_changed:
        try:
            output.touch()
        except OSError as error:
            raise StoreError(f"{output}: its time cannot be set: {error.strerror}.") from error
    if depfile is not None:
        write_file(depfile, dependencies(output, inputs).encode())


def dependencies(output: Path, inputs: Iterable[Path]) -> str:
    """Return a rule without commands, and an empty one an input so that a removed one stops nothing."""
    names = [_escaped(path) for path in dict.fromkeys(inputs)]
    return "".join([f"{_escaped(output)}: {' '.join(names)}\n", *(f"{name}:\n" for name in names)])


def _escaped(path: Path) -> str:
    text = str(path).replace("$", "$$").replace("#", r"\#").replace(" ", r"\ ")
    if "\n" in text or "\t" in text:
        raise UsageError(f"{text!r}: Make cannot name a file with a tab or line break in its name.")
    return text


def reasons_to_make(
    current: Artifact | None,
    operation: Operation,
    paths: Sequence[Path],
    note: str | None,
    parents: Sequence[ParentRecord] | None = (),
) -> tuple[str, ...]:
    """Return, in words, why an artifact is not what an operation on these inputs would give; none if it is.

    Args:
        current: The artifact that is there, if any.
        operation: What would be done.
        paths: Files that it would be done with.
        note: That would be kept.
        parents: Skills that it would be done with; None where the operation says which they are.
    """
    if current is None:
        return ("there is no readable skill yet",)
    there = current.provenance
    found = [_sha256(path) for path in paths]
    reasons = []
    if len(found) != len(there.inputs):
        reasons.append(f"it was made from {len(there.inputs)} files, not {len(found)}")
    else:
        changed = zip(paths, found, there.inputs, strict=True)
        reasons += [f"{path} has changed" for path, sha256, record in changed if sha256 != record.sha256]
    if parents is not None:
        reasons += _changed_parents(there.parents, parents)
    reasons += _changed_options(current.operation, operation)
    if note not in (None, current.operation.note):
        reasons.append("the note is another one")
    would_be = current_provenance(inputs=there.inputs, parents=there.parents if parents is None else parents)
    if would_be.tool != there.tool:
        reasons.append(f"it was made by skillctl {there.tool}, and this is {would_be.tool}")
    same = input_fingerprint(current.operation, there) == input_fingerprint(operation, would_be)
    return tuple(reasons) if reasons or same else ("it was made in another way",)


def _changed_parents(there: Sequence[ParentRecord], wanted: Sequence[ParentRecord]) -> list[str]:
    if len(there) != len(wanted):
        return [f"it was made from {len(there)} skills, not {len(wanted)}"]
    return [
        f"{after.role} is {_named(after)} and was {_named(before)}"
        for before, after in zip(there, wanted, strict=True)
        if before.digest != after.digest
    ]


def _named(parent: ParentRecord) -> str:
    name = parent.name if parent.version is None else f"{parent.name}@{parent.version}"
    return f"{name} ({parent.digest.removeprefix('sha256:')[:12]})"


def candidates_digest(digests: Iterable[str]) -> str:
    """Return one digest for the skills that there are to choose from, in this order."""
    return f"sha256:{hashlib.sha256(' '.join(digests).encode()).hexdigest()}"


def _changed_options(there: Operation, wanted: Operation) -> list[str]:
    before, after = (
        {**operation.model_dump(mode="json")["options"], "seed": operation.seed}
        for operation in (there, wanted)
    )
    names = sorted(before.keys() | after.keys())
    return [
        "the skills to choose from are others"
        if name == CANDIDATES
        else f"{name} is {_value(after.get(name))} and was {_value(before.get(name))}"
        for name in names
        if before.get(name) != after.get(name)
    ]


def _value(value: object) -> str:
    if isinstance(value, list | tuple):
        return ",".join(map(_value, value))
    return "not set" if value is None else str(value)


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    except OSError:
        return ""  # the reader says in words what is wrong with it
