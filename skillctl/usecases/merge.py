"""Merge skills into one in which all act together on one target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from skillctl.adapt.candidates import Candidates, candidates_from_store, require_same_space
from skillctl.adapt.options import TaskOptions
from skillctl.adapt.pace import PERIOD, paced
from skillctl.adapt.task import FittedMerger, TaskErrors, fit_to_task
from skillctl.adapt.together import Refit, Together, prepared, prove_together
from skillctl.compose.options import MergeOptions
from skillctl.demonstrations.faults import Fault, told
from skillctl.errors import UsageError
from skillctl.evaluate.errors import strays
from skillctl.model.coordinates.chain import IDENTITY
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Artifact, DemonstrationReport, Lock, Operation, input_record
from skillctl.store.source import Source, open_skill
from skillctl.store.ties import LyapunovOrigin
from skillctl.usecases.destination import Destination
from skillctl.usecases.make import (
    CANDIDATES,
    Made,
    MakeReport,
    PartSummary,
    Request,
    candidates_digest,
    child_artifact,
    make,
    parents_of,
    reports_on,
    require_stable,
    write_child,
)

ANGLES = "the errors count angles by the characteristic length of the skills."
LATE = 1.05  # times as long as demonstrated: a later merger has a note
STRAY = (
    0.05  # of the extent; skills are within 1 or 2 % of what they were taught, mixtures of two ways 5 to 30 %
)


@dataclass(frozen=True)
class TaskReport:
    """How a merger was fitted to demonstrations of a new task.

    Attributes:
        choice: How the weights were found; see ``skillctl.adapt.task.FittedMerger``.
        demonstrations: How many were given.
        candidates: Number of skills to choose from.
        errors: Mean DTW distances to the demonstrations.
        held_out: The same, each demonstration with weights fitted to the others; None for a single one.
    """

    choice: str
    demonstrations: int
    candidates: int
    errors: TaskErrors
    held_out: TaskErrors | None


@dataclass(frozen=True, kw_only=True)
class MergeReport(MakeReport):
    """What ``merge`` did.

    Attributes:
        parts: What it was made of; shares are the part weights.
        gate, parameters, speed: How the parts act together; parameters of the gate, by name.
        attractor, unit: Where all of them end.
        lyapunov: Origin of the common Lyapunov matrix; see ``skillctl.adapt.together.Together``.
        refits: Leaves that were learned again, if any.
        task: How it was fitted to a task; None if it was not, or was up to date.
        target: The attractor in the numbers in which a target is given; of poses with a quaternion.
    """

    parts: tuple[PartSummary, ...]
    gate: str
    parameters: dict[str, float]
    speed: float
    attractor: tuple[float, ...]
    unit: str
    lyapunov: LyapunovOrigin
    refits: tuple[Refit, ...] = ()
    task: TaskReport | None = None
    target: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Details:
    """What the report says besides the skill: the common proof, the task and notes."""

    together: Together
    task: TaskReport | None = None
    notes: tuple[str, ...] = ()


def merge(
    skills: Sequence[str | Path],
    *,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    lock: Lock | None = None,
    note: str | None = None,
    options: MergeOptions | None = None,
    task: TaskOptions | None = None,
    refit: bool = True,
    force: bool = False,
    plot: Path | None = None,
    progress: Progress | None = None,
) -> MergeReport:
    """Merge skills into one in which all act together, prove it stable, and write it.

    Args:
        skills: References to two or more SEDS or merged skills.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        note: To be kept in the skill.
        options: How the parts act together.
        task: Fit the weights to demonstrations of a new task.
        refit: Learn the parts again from their embedded demonstrations if no common Lyapunov matrix exists.
        force: Make it even if the same inputs and options gave what is there.
        plot: Draw the skill beside its parents there; the suffix decides the format.
        progress: Called with (stage, done, total) while parts are refitted.

    Raises:
        UsageError: Options that do not go together, a combined skill, different spaces.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        InputDataError: Demonstrations of the task that cannot be used.
        FitError: No common Lyapunov matrix, and no refit possible or wanted; or no proof.
    """
    options = options or MergeOptions()
    request = Request(Destination.at(output, name, store, note), force, plot)
    if task is not None:
        _require_free_weights(options)
        made, sources = _fitted(request, skills, lock, options.target, task, refit, progress)
    else:
        sources = [open_skill(reference, store, lock) for reference in skills]
        made = _merged(request, sources, options, refit, progress)
    return _report(request, made, sources)


def _merged(
    request: Request,
    sources: Sequence[Source],
    options: MergeOptions,
    refit: bool,
    progress: Progress | None,
) -> Made[_Details]:
    """Merge skills with weights that are given."""
    operation = Operation(command="merge", options={**options.recorded(), "refit": refit})

    def build() -> tuple[Artifact, Certificate, _Details]:
        _try(options, sources)
        given = options.speed or 1.0
        ready = prepared(sources, options)
        together = prove_together(ready, options.merge, speed=given, refit=refit, progress=progress)
        merged = options.merge(together.parts, together.lyapunov)
        merged, notes = _paced(merged, ready) if options.speed is None else (merged, [])
        certificate = require_stable(certify(merged))
        done = operation.model_copy(update={"results": together.results})
        artifact = child_artifact(merged, sources, done, together.reports, turn=options.turn)
        return artifact, certificate, _Details(together, notes=(*notes, *_follows_none(artifact)))

    return make(request, operation, build, parents=parents_of(sources), fits=partial(_fits, sources))


def _paced(merged: MergedSkill, sources: Sequence[Source]) -> tuple[MergedSkill, list[str]]:
    """Return a merger as fast as its parts were demonstrated, and sentences for the user.

    It stays proved for the controller period that the parts were learned for, where they are proved for it.
    """
    shown, shares = [], []
    for share, source in zip(merged.shares.tolist(), sources, strict=True):
        motions = tuple(motion for leaf in source.artifact.demonstrations for motion in leaf or ())
        if motions:
            shown.append(DemonstrationSet(motions, merged.space))
            shares.append(share)
    if not shown:
        return merged, ["no skill carries demonstrations that would tell how fast to move."]
    learned = [source.artifact.operation.options.get("period") for source in sources]
    period = max([PERIOD, *(each for each in learned if isinstance(each, float))])
    found = paced(merged, shown, shares, period=period)
    return found.skill, _lateness(found.late)


def _lateness(late: float) -> list[str]:
    """Return a sentence if the motions of a merger take ``late`` times as long as demonstrated."""
    if late < LATE:
        return []
    return [
        f"its motions take {late:.2g} times as long as the demonstrations: faster ones would not be proved "
        "for the controller period that its parts are proved for."
    ]


def _fitted(
    request: Request,
    skills: Sequence[str | Path],
    lock: Lock | None,
    target: tuple[float, ...] | None,
    task: TaskOptions,
    refit: bool,
    progress: Progress | None,
) -> tuple[Made[_Details], Sequence[Source]]:
    """Merge skills with weights fitted to demonstrations; return also those that could have been used."""
    read = task.reading.read(task.demonstrations)
    demonstrations = read.demonstrations
    found = _candidates(request.destination, skills, lock, task, demonstrations)
    sources, plain = found.helpful, MergeOptions(target=target)
    chosen = {
        "target": target,
        "refit": refit,
        "fit_level": task.level,
        "from_store": task.from_store,
        CANDIDATES: candidates_digest(found.digests),
    }
    reading = {key: value for key, value in task.reading.recorded().items() if value is not None}
    operation = Operation(command="merge", options={**reading, **chosen})

    def build() -> tuple[Artifact, Certificate, _Details]:
        require_same_space(sources, demonstrations)
        _try(plain, sources)
        together = prove_together(prepared(sources, plain), plain.merge, refit=refit, progress=progress)
        fitted = fit_to_task(
            together.parts, demonstrations, together.lyapunov, level=task.level, target=target
        )
        certificate = require_stable(certify(fitted.skill))
        done = operation.model_copy(update={"results": _results(fitted, together, read.faults)})
        inputs = [input_record(file.path, file.sha256, file.importer) for file in read.sources]
        used = [sources[index] for index in fitted.used]
        artifact = child_artifact(fitted.skill, used, done, _carried_reports(fitted, together), inputs)
        if fitted.choice == "per component":  # the leaves move differently than before
            artifact = replace(artifact, reports=reports_on(artifact))
        report = TaskReport(
            fitted.choice, len(demonstrations), len(found.digests), fitted.errors, fitted.held_out
        )
        idle = [source.name for i, source in enumerate(sources) if i not in fitted.used]
        left_out = [f"{', '.join(idle)}: no weight, left out."] if idle else []
        angles = [] if fitted.skill.space.flat else [ANGLES]
        notes = (*read.notes, *found.notes, *left_out, *_lateness(fitted.late), *angles)
        return artifact, certificate, _Details(together, report, notes)

    fits = partial(_fits, sources)
    return make(request, operation, build, inputs=task.demonstrations, parents=None, fits=fits), sources


def _fits(sources: Sequence[Source], there: Artifact) -> bool:
    """Return whether a skill can have been merged from some of the sources, one part for each parent."""
    parents = {record.digest for record in there.provenance.parents}
    known = parents <= {source.artifact.digest for source in sources}
    return known and there.skill.kind == "merged" and len(there.skill.parts) == len(there.provenance.parents)


def _candidates(
    destination: Destination,
    skills: Sequence[str | Path],
    lock: Lock | None,
    task: TaskOptions,
    demonstrations: DemonstrationSet,
) -> Candidates:
    """Return the skills that are named, or those of the store that help with the task."""
    if not task.from_store:
        sources = tuple(open_skill(reference, destination.store, lock) for reference in skills)
        return Candidates(sources, tuple(source.artifact.digest for source in sources))
    if skills:
        raise UsageError(
            "skills and --from-store exclude each other.",
            hint="Name skills, or let all of the store take part.",
        )
    return candidates_from_store(destination.store, demonstrations, lock, but=destination.name)


def _try(options: MergeOptions, sources: Sequence[Source]) -> None:
    """Raise UsageError for options that do not fit the skills, before any work is done.

    Any P and any coordinates serve here.
    """
    parents = [
        source.skill.with_leaves(lambda leaf: replace(leaf, coordinates=IDENTITY)) for source in sources
    ]
    options.merge(parents, parents[0].leaves[0].lyapunov)


def _report(request: Request, made: Made[_Details], sources: Sequence[Source]) -> MergeReport:
    """Write what was made, and report it with those of the sources that are its parents."""
    artifact, details, skill = made.artifact, made.details, made.artifact.skill
    by_digest = {source.artifact.digest: source for source in sources}
    used = [by_digest[record.digest] for record in artifact.provenance.parents]
    notes = (*details.together.notes, *details.notes) if details else ()
    return MergeReport(
        **write_child(request, made, "merged", used, skill.shares.tolist(), notes),
        gate=skill.gate,
        parameters=dict(skill.parameters),
        speed=skill.speed,
        attractor=tuple(skill.attractors[0].tolist()),
        unit=skill.space.unit,
        lyapunov=cast("LyapunovOrigin", artifact.operation.results["lyapunov"]),
        refits=details.together.refits if details else (),
        task=details.task if details else None,
        target=skill.space.given(skill.attractors[0]),
    )


def _follows_none(artifact: Artifact) -> tuple[str, ...]:
    """Return a sentence if a merged skill's motions are far from what any of its parts was taught."""
    off = strays(cast(MergedSkill, artifact.skill), artifact.demonstrations)
    if not off or min(off) <= STRAY:
        return ()
    return (
        "its motions follow none of the parts: from the starts of their demonstrations they are "
        f"{min(off):.0%} to {max(off):.0%} of the extent off, on average. Combined skills keep their ways.",
    )


def _require_free_weights(options: MergeOptions) -> None:
    """Raise UsageError if options are given that fitting chooses itself."""
    if options.turn:
        raise UsageError("turn and fit exclude each other.", hint="Leave out --turn, or --fit.")
    for given, what in (
        (options.part_weights is not None, "weights"),
        (options.gate != "superposition", "gate"),
        *((True, name) for name in options.parameters),
        (options.speed is not None, "speed"),
    ):
        if given:
            raise UsageError(
                f"{what} and fit exclude each other: fitting chooses the weights of a superposition, and its "
                "speed.",
                hint=f"Leave out --{what}, or --fit.",
            )


def _carried_reports(fitted: FittedMerger, together: Together) -> list[DemonstrationReport]:
    """Return the reports on the leaves of the parts that are used, numbered by the leaves of the child."""
    owners = [index for index, part in enumerate(together.parts) for _ in part.leaves]
    kept = [leaf for leaf, owner in enumerate(owners) if owner in fitted.used]
    return [
        report.model_copy(update={"leaf": kept.index(report.leaf)})
        for report in sorted(together.reports, key=lambda report: report.leaf)
        if report.leaf in kept
    ]


def _results(fitted: FittedMerger, together: Together, faults: Sequence[Fault]) -> dict[str, Any]:
    results = {**together.results, "choice": fitted.choice, "warnings": told(faults)}
    for name, errors in (("errors", fitted.errors), ("held_out", fitted.held_out)):
        if errors is not None:
            results[name] = (errors.best_single, errors.equal, errors.fitted)
    return results
