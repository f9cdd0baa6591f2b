"""Several skills of which one acts at a time, chosen by where the motion starts; proved and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from skillctl import compose
from skillctl.arrays import FloatArray
from skillctl.compose import PartCoverage
from skillctl.errors import FitError
from skillctl.model import CombinedSkill, Skill
from skillctl.model.skill import CombineGate
from skillctl.stability import Certificate, Scope, Verdict, certify
from skillctl.store import Operation
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.files import Source
from skillctl.usecases.parts import (
    PartSummary,
    carried_reports,
    child_artifact,
    open_parts,
    summaries,
)
from skillctl.usecases.proof import require_stable


@dataclass(frozen=True)
class CombineReport:
    """What ``combine`` did.

    Attributes:
        skill, path, digest: How to name it, where it is, what it is.
        created: False if exactly this skill was there already.
        parts: What it was made of; shares are the priors.
        gate, aligned: How the acting part is chosen, and whether all parts end at one place.
        attractors, unit: Where the parts end, one row a part.
        disturbance_distance: A jump of the state by more than this selects again (latched), in that unit.
        coverage: Of each part, how many of its demonstrations still start and end in it.
        verdict, scope: What is proved of the whole.
        rate, period: Proved: decay rate [1/s], and longest period of a controller [s]; None where not.
        not_guaranteed: What is not proved, in sentences; empty if everything is.
        notes: What else is worth knowing.
    """

    skill: str
    path: Path
    digest: str
    created: bool
    parts: tuple[PartSummary, ...]
    gate: CombineGate
    aligned: bool
    attractors: tuple[tuple[float, ...], ...]
    unit: str
    disturbance_distance: float
    coverage: tuple[PartCoverage, ...]
    verdict: Verdict
    scope: Scope
    rate: float | None
    period: float | None
    not_guaranteed: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class CombineOptions:
    """How parts are combined; see ``skillctl.compose.combine``."""

    part_priors: tuple[float, ...] | None = None
    gate: CombineGate = "latched"
    align: bool = False
    target: tuple[float, ...] | None = None
    disturbance_distance: float | None = None

    def combine(self, parts: Sequence[Skill], lyapunov: FloatArray | None = None) -> CombinedSkill:
        """Return the combined skill, under a common Lyapunov matrix (d, d) if one is given."""
        return compose.combine(
            parts,
            part_priors=self.part_priors,
            gate=self.gate,
            align=self.align,
            target=self.target,
            disturbance_distance=self.disturbance_distance,
            lyapunov=lyapunov,
        )


def combine(
    skills: Sequence[str | Path],
    *,
    output: Path | None = None,
    name: str | None = None,
    store: Path | None = None,
    options: CombineOptions | None = None,
) -> CombineReport:
    """Combine skills into one in which one part acts at a time, prove it, and write it.

    With the instantaneous gate and several attractors nothing global can be proved; such a skill is written
    all the same, and the report says what is not guaranteed.

    Args:
        skills: References to two or more skills; combined ones are taken apart.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        options: How the acting part is chosen, and where the parts end.

    Raises:
        UsageError: Options that make no sense, different spaces.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        FitError: What the gate promises could not be proved; nothing is written.
    """
    options = options or CombineOptions()
    destination = Destination(output, name, store)
    destination.current()
    sources = open_parts(skills, store)
    parents = [source.skill for source in sources]
    combined = _provable(parents, options)
    certificate = certify(combined)
    if options.gate == "latched" or combined.aligned:
        require_stable(certificate)
    else:
        _require_proved_parts(certificate)
    taught = [motions for source in sources for motions in source.artifact.demonstrations]
    coverage = compose.coverage(combined, taught)
    operation = Operation(
        command="combine", options=asdict(options), results={"kept": tuple(part.kept for part in coverage)}
    )
    written = destination.write(child_artifact(combined, sources, operation, carried_reports(sources)))
    return _report(written, sources, combined, coverage, certificate)


def _provable(parents: Sequence[Skill], options: CombineOptions) -> CombinedSkill:
    """Return the combined skill; where its proof needs a common Lyapunov matrix, with one."""
    combined = options.combine(parents)
    if options.gate == "latched" or not combined.aligned:
        return combined
    lyapunov = compose.common_lyapunov_of(parents)
    if lyapunov is None:
        raise FitError(
            "these skills have no common Lyapunov matrix, so nothing would be proved of switching between "
            "them at every instant.",
            hint="Use --gate latched, or learn the skills with --metric euclidean.",
        )
    return options.combine(parents, lyapunov)


def _require_proved_parts(certificate: Certificate) -> None:
    """Raise FitError unless each part alone is proved: the least that every combined skill promises."""
    if not all(part.proved for part in certificate.parts):
        raise FitError(
            f"a part could not be proved stable, so nothing was written: {certificate.failures[0]}",
            hint="Find the skill with `skillctl verify-stability`, and learn it again.",
        )


def _shares(parents: Sequence[Skill], combined: CombinedSkill) -> list[float]:
    """Return the prior of each parent: that of all its parts together, if it was a combined skill."""
    priors = iter(combined.part_priors.tolist())
    counts = [len(parent.parts) if isinstance(parent, CombinedSkill) else 1 for parent in parents]
    return [sum(next(priors) for _ in range(count)) for count in counts]


def _report(
    written: Written,
    sources: Sequence[Source],
    combined: CombinedSkill,
    coverage: tuple[PartCoverage, ...],
    certificate: Certificate,
) -> CombineReport:
    parents = [source.skill for source in sources]
    return CombineReport(
        skill=written.skill,
        path=written.path,
        digest=written.digest,
        created=written.created,
        parts=summaries(sources, _shares(parents, combined)),
        gate=combined.gate,
        aligned=combined.aligned,
        attractors=tuple(map(tuple, combined.attractors.tolist())),
        unit=combined.space.unit,
        disturbance_distance=combined.disturbance_distance,
        coverage=coverage,
        verdict=certificate.verdict,
        scope=certificate.scope,
        rate=certificate.rate,
        period=certificate.period,
        not_guaranteed=(*certificate.failures, *certificate.evidence),
        notes=compose.notes_on(parents),
    )
