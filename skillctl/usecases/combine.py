"""Combine skills of which one acts at a time, chosen by where the motion starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from skillctl.adapt.together import Refit, Together, prepared, prove_together
from skillctl.compose.options import CombineOptions
from skillctl.errors import FitError, UsageError
from skillctl.evaluate.coverage import (
    PartCoverage,
    calibrated_priors,
    coverage,
    same_targets,
    with_regions,
)
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import DemonstrationSet
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Artifact, Lock, Operation
from skillctl.store.source import Source, carried_demonstrations, carried_reports, open_skill
from skillctl.store.ties import LyapunovOrigin
from skillctl.usecases.destination import Destination
from skillctl.usecases.make import (
    Made,
    MakeReport,
    PartSummary,
    Request,
    child_artifact,
    make,
    parents_of,
    require_stable,
    write_child,
)


@dataclass(frozen=True, kw_only=True)
class CombineReport(MakeReport):
    """What ``combine`` did.

    Attributes:
        parts: What it was made of; shares are the priors.
        gate, aligned: How the acting part is chosen, and whether all parts end at one place.
        attractors, unit: Where the parts end, one row a part.
        disturbance_distance: A jump of the state by more than this selects again (latched), in that unit.
        coverage: Of each part, how many of its demonstrations start and end in it when they are left out.
        coverage_before: The same before priors were calibrated; None if they were not calibrated now.
        lyapunov: Origin of the common Lyapunov matrix; None if the proof needs no common one.
        refits: Leaves learned again, if any.
        targets: The attractors in the numbers in which targets are given; of poses with a quaternion.
    """

    parts: tuple[PartSummary, ...]
    gate: str
    aligned: bool
    attractors: tuple[tuple[float, ...], ...]
    unit: str
    disturbance_distance: float
    coverage: tuple[PartCoverage, ...]
    coverage_before: tuple[PartCoverage, ...] | None
    lyapunov: LyapunovOrigin | None
    refits: tuple[Refit, ...] = ()
    targets: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class _Details:
    """More for the report: coverage, now and before calibration, and the common proof."""

    coverage: tuple[PartCoverage, ...]
    before: tuple[PartCoverage, ...] | None = None
    together: Together | None = None


def combine(
    skills: Sequence[str | Path],
    *,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    lock: Lock | None = None,
    note: str | None = None,
    options: CombineOptions | None = None,
    refit: bool = True,
    force: bool = False,
    plot: Path | None = None,
    progress: Progress | None = None,
) -> CombineReport:
    """Combine skills into one in which one part acts at a time, prove it, and write it.

    With the instantaneous gate and several attractors nothing global can be proved. Such a skill is written
    nevertheless, and the report says what is not guaranteed.

    Args:
        skills: References to two or more skills; a combined one is replaced by its parts.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        note: To be kept in the skill.
        options: How the acting part is chosen, and where the parts end.
        refit: Learn the parts again from their embedded demonstrations where the proof needs a common
            Lyapunov matrix and none exists.
        force: Make it even if the same skills and options gave what is there.
        plot: Draw the skill beside its parents there; the suffix decides the format.
        progress: Called with (stage, done, total) while parts are refitted.

    Raises:
        UsageError: Options that do not go together, different spaces, no demonstrations to calibrate by.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        FitError: The guarantee of the gate could not be proved; nothing is written.
    """
    options = options or CombineOptions()
    if options.calibrate and options.part_priors is not None:
        raise UsageError("priors and calibrate exclude each other.", hint="Leave out one of them.")
    request = Request(Destination.at(output, name, store, note), force, plot)
    sources = [open_skill(reference, store, lock) for reference in skills]
    unchanged = {"turn": False, "refit": True}  # not recorded: skills of before have no such entries
    recorded = {**asdict(options), "refit": refit}
    recorded = {key: value for key, value in recorded.items() if unchanged.get(key, ...) is not value}
    operation = Operation(command="combine", options=recorded)

    def build() -> tuple[Artifact, Certificate, _Details]:
        combined, together = _combined(sources, options, refit, progress)
        combined, coverage, before = _covered(combined, sources, options)
        certificate = _require_guarantee(combined, certify(combined))
        results: dict[str, Any] = {"kept": tuple(part.kept for part in coverage if part.kept is not None)}
        results |= {} if together is None else together.results
        reports = carried_reports(sources) if together is None else together.reports
        done = operation.model_copy(update={"results": results})
        artifact = child_artifact(combined, sources, done, reports, turn=options.turn)
        return artifact, certificate, _Details(coverage, before, together)

    def fits(there: Artifact) -> bool:
        return len(there.skill.acting_parts) == sum(len(source.skill.acting_parts) for source in sources)

    made = make(request, operation, build, parents=parents_of(sources), fits=fits)
    return _report(request, made, sources)


def _combined(
    sources: Sequence[Source], options: CombineOptions, refit: bool, progress: Progress | None
) -> tuple[CombinedSkill, Together | None]:
    """Return the combined skill, and the common proof of its parts if the gate needs one."""
    combined = options.combine([source.skill for source in sources])
    if not (combined.reselects and combined.aligned):
        return combined, None
    ready = prepared(sources, options)
    together = prove_together(ready, options.combine, refit=refit, progress=progress)
    return options.combine(together.parts, together.lyapunov), together


def _covered(
    combined: CombinedSkill, sources: Sequence[Source], options: CombineOptions
) -> tuple[CombinedSkill, tuple[PartCoverage, ...], tuple[PartCoverage, ...] | None]:
    """Return the skill with regions, its priors calibrated if asked for; coverage after and before that."""
    taught: Sequence[DemonstrationSet | None]
    taught = [motions for source in sources for motions in source.artifact.demonstrations]
    if options.turn:
        taught = carried_demonstrations(sources, combined.leaves, turn=True)
    combined = with_regions(combined, taught)
    measured = coverage(combined, taught)
    if not options.calibrate:
        return combined, measured, None
    calibrated = replace(combined, part_priors=calibrated_priors(combined, taught))
    return calibrated, coverage(calibrated, taught), measured


def _require_guarantee(combined: CombinedSkill, certificate: Certificate) -> Certificate:
    """Return the certificate, or raise FitError if it does not prove what the gate guarantees.

    An instantaneous gate with several attractors guarantees only that each part alone is stable.
    """
    if combined.aligned or not combined.reselects:
        return require_stable(certificate)
    if not all(part.proved for part in certificate.parts):
        raise FitError(
            f"a part could not be proved stable, so nothing was written: {certificate.failures[0]}",
            hint="Find the skill with `skillctl verify-stability`, and learn it again.",
        )
    return certificate


def _report(request: Request, made: Made[_Details], sources: Sequence[Source]) -> CombineReport:
    """Write what was made, and report it."""
    artifact, details = made.artifact, made.details
    combined = cast("CombinedSkill", artifact.skill)
    together = details.together if details else None
    priors = iter(combined.part_priors.tolist())
    # The prior of a combined parent is that of all its parts together.
    shares = [sum(next(priors) for _ in source.skill.acting_parts) for source in sources]
    notes = (*(together.notes if together else ()), *_nearly_one_target(combined))
    return CombineReport(
        **write_child(request, made, "combined", sources, shares, notes),
        gate=combined.gate,
        aligned=combined.aligned,
        attractors=tuple(map(tuple, combined.part_attractors.tolist())),
        unit=combined.space.unit,
        disturbance_distance=combined.disturbance_distance,
        coverage=details.coverage if details else coverage(combined, artifact.demonstrations),
        coverage_before=details.before if details else None,
        lyapunov=cast("LyapunovOrigin | None", artifact.operation.results.get("lyapunov")),
        refits=together.refits if together else (),
        targets=tuple(map(combined.space.given, combined.part_attractors)),
    )


def _nearly_one_target(combined: CombinedSkill) -> list[str]:
    """Return a sentence for each pair of parts whose targets one would not tell apart."""
    unit = combined.space.unit
    return [
        f"the targets of parts {first} and {second} are only {gap:.2g} {unit} apart; --align makes them one."
        for first, second, gap in same_targets(combined)
    ]
