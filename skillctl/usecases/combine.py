"""Several skills of which one acts at a time, chosen by where the motion starts; proved and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from skillctl.adapt.refit import Refit
from skillctl.adapt.together import LyapunovOrigin, Together, prove_together
from skillctl.compose.options import CombineOptions
from skillctl.compose.parts import notes_on
from skillctl.errors import FitError, UsageError
from skillctl.evaluate.coverage import PartCoverage, calibrated_priors, coverage
from skillctl.model.combined import CombinedSkill
from skillctl.model.skill import Skill
from skillctl.plotting.formats import require_picture
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate, Scope, Verdict
from skillctl.store import Artifact, Lock, Operation
from skillctl.store.source import Source, carried_reports
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.make import reasons_to_make
from skillctl.usecases.parts import (
    PartSummary,
    child_artifact,
    draw_family,
    open_parts,
    parents_of,
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
        coverage_before: The same before priors were calibrated; None if they were not.
        lyapunov: How the parts came to one Lyapunov matrix; None where the proof needs no common one.
        refits: Leaves learned again, if any.
        verdict, scope: What is proved of the whole.
        rate, period: Proved: decay rate [1/s], and longest period of a controller [s]; None where not.
        not_guaranteed: What is not proved, in sentences; empty if everything is.
        notes: What else is worth knowing.
        status: ``combined``, or ``up to date``: the same skills and options gave what is there. Then nothing
            was calibrated or learned again.
        reasons: Why it was made, in words; none if it was up to date.
    """

    skill: str
    path: Path
    digest: str
    created: bool
    parts: tuple[PartSummary, ...]
    gate: str
    aligned: bool
    attractors: tuple[tuple[float, ...], ...]
    unit: str
    disturbance_distance: float
    coverage: tuple[PartCoverage, ...]
    coverage_before: tuple[PartCoverage, ...] | None
    lyapunov: LyapunovOrigin | None
    refits: tuple[Refit, ...]
    verdict: Verdict
    scope: Scope
    rate: float | None
    period: float | None
    not_guaranteed: tuple[str, ...]
    notes: tuple[str, ...]
    status: Literal["combined", "up to date"] = "combined"
    reasons: tuple[str, ...] = ()


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

    With the instantaneous gate and several attractors nothing global can be proved; such a skill is written
    all the same, and the report says what is not guaranteed.

    Args:
        skills: References to two or more skills; combined ones are taken apart.
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
        UsageError: Options that make no sense, different spaces, nothing to calibrate by.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        FitError: What the gate promises could not be proved; nothing is written.
    """
    options = options or CombineOptions()
    if options.calibrate and options.part_priors is not None:
        raise UsageError("priors and calibrate exclude each other.", hint="Leave out one of them.")
    destination = Destination.at(output, name, store, note)
    if plot is not None:
        require_picture(plot)
    sources = open_parts(skills, store, lock)
    operation = _operation(options, refit)
    current = destination.current()
    reasons = reasons_to_make(current[0] if current else None, operation, (), note, parents_of(sources))
    if current is not None and not reasons and not force:
        return _kept(current, sources, plot)
    combined, together, measured, certificate = _proved(sources, options, refit, progress)
    operation = operation.model_copy(update={"results": _results(measured.coverage, together)})
    reports = carried_reports(sources) if together is None else together.reports
    artifact = child_artifact(combined, sources, operation, reports)
    written = destination.write(artifact)
    if plot is not None:
        draw_family(written.skill, artifact, sources, _shares([s.skill for s in sources], combined), plot)
    report = _report(written, sources, combined, measured, together, certificate)
    return replace(report, reasons=reasons or ("it was asked for",))


def _proved(
    sources: Sequence[Source], options: CombineOptions, refit: bool, progress: Progress | None
) -> tuple[CombinedSkill, Together | None, _Measured, Certificate]:
    """Return the combined skill, what made one proof serve all parts, what parts keep, and the proof."""
    combined = options.combine([source.skill for source in sources])
    together = None
    if options.gate == "instantaneous" and combined.aligned:
        together = prove_together(sources, options.combine, refit=refit, progress=progress)
        combined = options.combine(together.parts, together.lyapunov)
    taught = [motions for source in sources for motions in source.artifact.demonstrations]
    measured = _Measured(coverage(combined, taught), None)
    if options.calibrate:
        combined = replace(combined, part_priors=calibrated_priors(combined, taught))
        measured = _Measured(coverage(combined, taught), measured.coverage)
    certificate = certify(combined)
    if options.gate == "latched" or combined.aligned:
        require_stable(certificate)
    else:
        _require_proved_parts(certificate)
    return combined, together, measured, certificate


def _kept(current: tuple[Artifact, Written], sources: Sequence[Source], plot: Path | None) -> CombineReport:
    """Return the report on a skill that is there already, made of these parents."""
    artifact, written = current
    combined = artifact.skill
    assert isinstance(combined, CombinedSkill)  # its operation says so
    if plot is not None:
        draw_family(written.skill, artifact, sources, _shares([s.skill for s in sources], combined), plot)
    measured = _Measured(coverage(combined, artifact.demonstrations), None)
    report = _report(written, sources, combined, measured, None, certify(combined))
    origin: Any = artifact.operation.results.get("lyapunov")
    return replace(report, status="up to date", lyapunov=origin)


@dataclass(frozen=True)
class _Measured:
    """Coverage, and what it was before priors were calibrated, if they were."""

    coverage: tuple[PartCoverage, ...]
    before: tuple[PartCoverage, ...] | None


def _operation(options: CombineOptions, refit: bool) -> Operation:
    """Return what decides the result; what came of it is not known yet."""
    recorded = asdict(options) if refit else {**asdict(options), "refit": False}
    return Operation(command="combine", options=recorded)


def _results(coverage: Sequence[PartCoverage], together: Together | None) -> dict[str, Any]:
    results: dict[str, Any] = {"kept": tuple(part.kept for part in coverage)}
    return results if together is None else results | together.results


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
    measured: _Measured,
    together: Together | None,
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
        attractors=tuple(map(tuple, combined.part_attractors.tolist())),
        unit=combined.space.unit,
        disturbance_distance=combined.disturbance_distance,
        coverage=measured.coverage,
        coverage_before=measured.before,
        lyapunov=None if together is None else together.origin,
        refits=() if together is None else together.refits,
        verdict=certificate.verdict,
        scope=certificate.scope,
        rate=certificate.rate,
        period=certificate.period,
        not_guaranteed=(*certificate.failures, *certificate.evidence),
        notes=(*notes_on(parents), *(() if together is None else together.notes)),
    )
