"""Several skills acting together on one target, proved and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from skillctl import compose
from skillctl.arrays import FloatArray
from skillctl.errors import FitError
from skillctl.model import MergedSkill, Skill
from skillctl.model.skill import MergeGate
from skillctl.stability import Certificate, certify
from skillctl.store import DemonstrationReport, Operation
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.files import Source
from skillctl.usecases.parts import (
    PartSummary,
    carried_reports,
    child_artifact,
    open_parts,
    summaries,
)
from skillctl.usecases.progress import Progress
from skillctl.usecases.proof import require_stable
from skillctl.usecases.refit import Refit, conflict_of, refit_parts

LyapunovOrigin: TypeAlias = Literal["shared", "found", "refitted"]


@dataclass(frozen=True)
class MergeReport:
    """What ``merge`` did.

    Attributes:
        skill, path, digest: How to name it, where it is, what it is.
        created: False if exactly this skill was there already.
        parts: What it was made of; shares are the part weights.
        gate, sharpness, speed: How the parts act together.
        attractor, unit: Where all of them end.
        lyapunov: ``shared`` by all parts already, ``found`` for all of them, or parts ``refitted`` under one.
        refits: Leaves learned again, if any.
        rate, period: Proved: decay rate [1/s], and longest period of a controller [s].
        notes: What is worth knowing.
    """

    skill: str
    path: Path
    digest: str
    created: bool
    parts: tuple[PartSummary, ...]
    gate: MergeGate
    sharpness: float
    speed: float
    attractor: tuple[float, ...]
    unit: str
    lyapunov: LyapunovOrigin
    refits: tuple[Refit, ...]
    rate: float | None
    period: float | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class MergeOptions:
    """How parts are merged; see ``skillctl.compose.merge``."""

    part_weights: tuple[float, ...] | None = None
    gate: MergeGate = "superposition"
    sharpness: float = 1.0
    speed: float = 1.0
    target: tuple[float, ...] | None = None

    def merge(self, parts: Sequence[Skill], lyapunov: FloatArray) -> MergedSkill:
        """Return the merged skill under a common Lyapunov matrix (d, d)."""
        return compose.merge(
            parts,
            part_weights=self.part_weights,
            gate=self.gate,
            sharpness=self.sharpness,
            speed=self.speed,
            target=self.target,
            lyapunov=lyapunov,
        )


def merge(
    skills: Sequence[str | Path],
    *,
    output: Path | None = None,
    name: str | None = None,
    store: Path | None = None,
    options: MergeOptions | None = None,
    refit: bool = True,
    progress: Progress | None = None,
) -> MergeReport:
    """Merge skills into one in which all act together, prove it stable, and write it.

    Args:
        skills: References to two or more SEDS or merged skills.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        options: How the parts act together.
        refit: Learn the parts again from their embedded demonstrations if no common Lyapunov matrix exists.
        progress: Called with (stage, done, total) while parts are refitted.

    Raises:
        UsageError: Options that make no sense, a combined skill, different spaces.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        FitError: No common Lyapunov matrix, and no refit possible or wanted; or no proof.
    """
    options = options or MergeOptions()
    destination = Destination(output, name, store)
    destination.current()
    sources = open_parts(skills, store)
    parents = [source.skill for source in sources]
    options.merge(parents, np.eye(parents[0].dimension))  # complains about options before any work is done
    reports = carried_reports(sources)
    attempt = _proved_as_they_are(parents, options)
    if attempt is None:
        attempt, reports = _refitted(sources, options, refit, progress)
    certificate = certify(attempt.skill)
    require_stable(certificate)
    operation = _operation(options, refit, attempt)
    written = destination.write(child_artifact(attempt.skill, sources, operation, reports))
    return _report(written, sources, options, attempt, certificate)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A merged skill, and how its parts came to one Lyapunov matrix."""

    skill: MergedSkill
    lyapunov: LyapunovOrigin
    refits: tuple[Refit, ...] = ()


def _proved_as_they_are(parts: Sequence[Skill], options: MergeOptions) -> _Attempt | None:
    """Return the merged skill if one Lyapunov matrix provably serves all parts, else None."""
    lyapunov = compose.common_lyapunov_of(parts)
    if lyapunov is None:
        return None
    merged = options.merge(parts, lyapunov)
    if certify(merged).verdict != "stable":
        return None
    shared = all((leaf.lyapunov == lyapunov).all() for part in parts for leaf in part.leaves)
    return _Attempt(merged, "shared" if shared else "found")


def _refitted(
    sources: Sequence[Source], options: MergeOptions, refit: bool, progress: Progress | None
) -> tuple[_Attempt, list[DemonstrationReport]]:
    """Return the merged skill of parts learned again under one Lyapunov matrix, and their errors."""
    if not refit:
        raise FitError(
            f"{conflict_of(sources)} have no common Lyapunov matrix: a merger would not be proved.",
            hint="Leave out --no-refit to learn them again under a common one.",
        )
    again = refit_parts(sources, progress)
    return _Attempt(options.merge(again.parts, again.lyapunov), "refitted", again.refits), list(again.reports)


def _operation(options: MergeOptions, refit: bool, attempt: _Attempt) -> Operation:
    results: dict[str, Any] = {"lyapunov": attempt.lyapunov}
    if attempt.refits:
        results["dtw_before"] = tuple(refit.dtw_before for refit in attempt.refits)
        results["dtw_after"] = tuple(refit.dtw_after for refit in attempt.refits)
    return Operation(command="merge", options={**asdict(options), "refit": refit}, results=results)


def _report(
    written: Written,
    sources: Sequence[Source],
    options: MergeOptions,
    attempt: _Attempt,
    certificate: Certificate,
) -> MergeReport:
    return MergeReport(
        skill=written.skill,
        path=written.path,
        digest=written.digest,
        created=written.created,
        parts=summaries(sources, attempt.skill.part_weights.tolist()),
        gate=options.gate,
        sharpness=options.sharpness,
        speed=options.speed,
        attractor=tuple(attempt.skill.attractor.tolist()),
        unit=attempt.skill.space.unit,
        lyapunov=attempt.lyapunov,
        refits=attempt.refits,
        rate=certificate.rate,
        period=certificate.period,
        notes=compose.notes_on([source.skill for source in sources]),
    )
