"""The differences between two skills: identity, metadata, parameters, behaviour, and what is proved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillctl.compose.parts import in_one_space
from skillctl.errors import UsageError
from skillctl.evaluate.comparison import (
    Behaviour,
    LeafDifference,
    compare_behaviour,
    leaf_differences,
    proofs_agree,
)
from skillctl.evaluate.stage_comparison import StageDifference, same_course, stage_differences
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Lock, metadata_of
from skillctl.store.source import open_skill

DEFAULT_TOLERANCE = 1e-9  # far above what rounding does to a velocity, far below what an arm can follow


@dataclass(frozen=True)
class Side:
    """One of the two skills."""

    skill: str
    path: Path
    digest: str


@dataclass(frozen=True)
class Change:
    """A metadata field with two values; None where a side does not have it."""

    field: str
    a: Any
    b: Any


@dataclass(frozen=True, eq=False)
class DiffReport:
    """The differences between two skills.

    Attributes:
        a, b: The skills.
        identical: Equal content digests: nothing differs.
        differs: Whether behaviour or certificates differ by more than the tolerances.
        atol, rtol: The tolerances.
        unit: Of positions.
        metadata: Fields that differ.
        leaves: Differences of the leaves; None if the skills have other numbers of leaves or other spaces.
        behaviour: How differently they move.
        certificates: What is proved of a and b, derived now.
        stages: Of two chains, what has become of each stage.
        proofs_agree: Whether verdicts and scopes are the same, and rates and periods within the tolerances.
    """

    a: Side
    b: Side
    identical: bool
    differs: bool
    atol: float
    rtol: float
    unit: str
    metadata: tuple[Change, ...]
    leaves: tuple[LeafDifference, ...] | None
    behaviour: Behaviour
    certificates: tuple[Certificate, Certificate]
    proofs_agree: bool
    stages: tuple[StageDifference, ...] = ()


def diff(
    first: str | Path,
    second: str | Path,
    *,
    atol: float = DEFAULT_TOLERANCE,
    rtol: float = DEFAULT_TOLERANCE,
    store: Path | None = None,
    lock: Lock | None = None,
) -> DiffReport:
    """Compare two skills.

    Args:
        first: Reference of a.
        second: Reference of b.
        atol: Velocities, positions and rates may differ by this much, in their units,
        rtol: plus this share of those of a.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        UsageError: A negative tolerance.
        NotFoundError, ArtifactError: A reference leads to no intact skill.
    """
    if not (atol >= 0 and rtol >= 0):
        raise UsageError("--atol and --rtol: must not be negative.")
    sources = [open_skill(reference, store, lock) for reference in (first, second)]
    a, b = in_one_space([source.skill for source in sources])
    certificates = (certify(a), certify(b))
    agree = proofs_agree(*certificates, atol, rtol)
    taught = [motion for source in sources for motion in source.artifact.taught]
    behaviour = compare_behaviour(a, b, taught, atol, rtol)
    sides = [Side(s.name, s.located.path, s.artifact.digest) for s in sources]
    before, after = (metadata_of(source.artifact) for source in sources)
    return DiffReport(
        sides[0],
        sides[1],
        identical=sides[0].digest == sides[1].digest,
        differs=not (behaviour.same and agree and same_course(a, b, atol, rtol)),
        atol=atol,
        rtol=rtol,
        unit=a.space.unit,
        metadata=_changes(before, after),
        leaves=leaf_differences(a, b),
        behaviour=behaviour,
        certificates=certificates,
        proofs_agree=agree,
        stages=stage_differences(a, b),
    )


def _changes(a: Any, b: Any, path: str = "") -> tuple[Change, ...]:
    """Return every leaf of two JSON values that differs, by its dotted path."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = sorted(a.keys() | b.keys())
        found = (_changes(a.get(key), b.get(key), f"{path}.{key}".lstrip(".")) for key in keys)
        return tuple(change for changes in found for change in changes)
    nested = all(isinstance(value, list) and any(isinstance(v, dict) for v in value) for value in (a, b))
    if nested and len(a) == len(b):
        found = (_changes(x, y, f"{path}.{index}") for index, (x, y) in enumerate(zip(a, b, strict=True)))
        return tuple(change for changes in found for change in changes)
    return () if a == b else (Change(path, a, b),)
