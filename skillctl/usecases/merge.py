"""Several skills acting together on one target, proved and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skillctl.adapt.candidates import candidates_from_store, require_same_space
from skillctl.adapt.options import TaskOptions
from skillctl.adapt.refit import Refit
from skillctl.adapt.task import FittedMerger, TaskErrors, fit_to_task
from skillctl.adapt.together import LyapunovOrigin, Together, prove_together
from skillctl.compose.options import MergeOptions
from skillctl.compose.parts import notes_on
from skillctl.errors import UsageError
from skillctl.evaluate.errors import report_errors
from skillctl.model.merged import MergedSkill
from skillctl.plotting.formats import require_picture
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Artifact, DemonstrationReport, Lock, Operation, input_record
from skillctl.store.source import Source
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.make import CANDIDATES, candidates_digest, reasons_to_make
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
class TaskReport:
    """How a merger was fitted to demonstrations of a new task.

    Attributes:
        choice: The best way: ``one part``, ``equal weights``, ``weights per part`` or ``per component``.
        demonstrations: How many were given.
        candidates: How many skills could have been used.
        errors: Mean DTW distance to the demonstrations.
        held_out: The same, each demonstration with weights fitted to the others; None for a single one.
    """

    choice: str
    demonstrations: int
    candidates: int
    errors: TaskErrors
    held_out: TaskErrors | None


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
        task: How it was fitted to a task, if it was.
        rate, period: Proved: decay rate [1/s], and longest period of a controller [s].
        notes: What is worth knowing.
        status: ``merged``, or ``up to date``: the same inputs and options gave what is there. Then nothing
            was fitted or learned again.
        reasons: Why it was made, in words; none if it was up to date.
    """

    skill: str
    path: Path
    digest: str
    created: bool
    parts: tuple[PartSummary, ...]
    gate: str
    sharpness: float
    speed: float
    attractor: tuple[float, ...]
    unit: str
    lyapunov: LyapunovOrigin
    refits: tuple[Refit, ...]
    task: TaskReport | None
    rate: float | None
    period: float | None
    notes: tuple[str, ...]
    status: Literal["merged", "up to date"] = "merged"
    reasons: tuple[str, ...] = ()


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
        UsageError: Options that make no sense, a combined skill, different spaces.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        InputDataError: Demonstrations of the task that cannot be used.
        FitError: No common Lyapunov matrix, and no refit possible or wanted; or no proof.
    """
    options = options or MergeOptions()
    destination = Destination.at(output, name, store, note)
    if plot is not None:
        require_picture(plot)
    current = destination.current()
    if task is not None:
        return _merge_for_task(skills, destination, lock, options, task, refit, force, plot, progress)
    sources = open_parts(skills, store, lock)
    operation = Operation(command="merge", options={**options.recorded(), "refit": refit})
    reasons = reasons_to_make(current[0] if current else None, operation, (), note, parents_of(sources))
    if current is not None and not reasons and not force:
        return _kept(current, sources, plot)
    parents = [source.skill for source in sources]
    options.merge(parents, np.eye(parents[0].dimension))  # complains about options before any work is done
    together = prove_together(sources, options.merge, speed=options.speed, refit=refit, progress=progress)
    merged = options.merge(together.parts, together.lyapunov)
    certificate = certify(merged)
    require_stable(certificate)
    operation = operation.model_copy(update={"results": together.results})
    artifact = child_artifact(merged, sources, operation, together.reports)
    written = destination.write(artifact)
    if plot is not None:
        draw_family(written.skill, artifact, sources, merged.part_weights.tolist(), plot)
    report = _report(written, sources, merged, together, certificate)
    return replace(report, reasons=reasons or ("it was asked for",))


def _merge_for_task(
    skills: Sequence[str | Path],
    destination: Destination,
    lock: Lock | None,
    options: MergeOptions,
    task: TaskOptions,
    refit: bool,
    force: bool,
    plot: Path | None,
    progress: Progress | None,
) -> MergeReport:
    """Merge skills with weights fitted to demonstrations."""
    _require_free_weights(options)
    read = task.reading.read(task.demonstrations)
    shown = read.demonstrations
    if task.from_store and skills:
        raise UsageError(
            "skills and --from-store exclude each other.",
            hint="Name skills, or let all of the store take part.",
        )
    if task.from_store:
        found = candidates_from_store(destination.store, shown, lock, but=destination.name)
        sources, candidates, notes = list(found.helpful), found.digests, found.notes
    else:
        sources, notes = open_parts(skills, destination.store, lock), ()
        candidates = tuple(source.artifact.digest for source in sources)
    operation = _fit_operation(options, task, refit, candidates)
    current = destination.current()
    reasons = reasons_to_make(
        current[0] if current else None, operation, task.demonstrations, destination.note, None
    )
    if current is not None and not reasons and not force:
        return _kept(current, sources, plot)
    require_same_space(sources, shown)
    plain = MergeOptions(target=options.target)
    plain.merge([source.skill for source in sources], np.eye(sources[0].skill.dimension))
    together = prove_together(sources, plain.merge, refit=refit, progress=progress)
    fitted = fit_to_task(together.parts, shown, together.lyapunov, level=task.level, target=options.target)
    certificate = certify(fitted.skill)
    require_stable(certificate)
    used = [sources[index] for index in fitted.used]
    operation = operation.model_copy(update={"results": _results(fitted, together)})
    reports = _reports_of_used(fitted, used, together)
    inputs = [input_record(file.path, file.sha256, file.importer) for file in read.sources]
    artifact = child_artifact(fitted.skill, used, operation, reports, inputs)
    written = destination.write(artifact)
    if plot is not None:
        draw_family(written.skill, artifact, used, fitted.skill.part_weights.tolist(), plot)
    report = TaskReport(fitted.choice, len(shown), len(candidates), fitted.errors, fitted.held_out)
    made = _report(
        written,
        used,
        fitted.skill,
        together,
        certificate,
        report,
        (*read.notes, *notes, *_left_out(sources, fitted)),
    )
    return replace(made, reasons=reasons or ("it was asked for",))


def _kept(current: tuple[Artifact, Written], sources: Sequence[Source], plot: Path | None) -> MergeReport:
    """Return the report on a skill that is there already, made of some of these parents."""
    artifact, written = current
    merged = artifact.skill
    assert isinstance(merged, MergedSkill)  # its operation says so
    by_digest = {source.artifact.digest: source for source in sources}
    used = [by_digest[record.digest] for record in artifact.provenance.parents]
    if plot is not None:
        draw_family(written.skill, artifact, used, merged.part_weights.tolist(), plot)
    certificate = certify(merged)
    origin: Any = artifact.operation.results["lyapunov"]
    rate = certificate.rate or 0.0
    together = Together(merged.parts, merged.lyapunov, origin, rate, (), artifact.reports)
    return replace(_report(written, used, merged, together, certificate), status="up to date")


def _require_free_weights(options: MergeOptions) -> None:
    """Raise UsageError if weights to be fitted are given as well."""
    for given, what in (
        (options.part_weights is not None, "weights"),
        (options.gate != "superposition", "gate"),
        *((True, name) for name in options.parameters),
        (options.speed != 1, "speed"),
    ):
        if given:
            raise UsageError(
                f"{what} and fit exclude each other: fitting chooses the weights of a superposition, and "
                "their sum is its speed.",
                hint=f"Leave out --{what}, or --fit.",
            )


def _left_out(sources: Sequence[Source], fitted: FittedMerger) -> list[str]:
    names = [source.name for i, source in enumerate(sources) if i not in fitted.used]
    return [f"{', '.join(names)}: no weight, left out."] if names else []


def _reports_of_used(
    fitted: FittedMerger, used: Sequence[Source], together: Together
) -> list[DemonstrationReport]:
    """Return reports on the demonstrations of the parts that are used, numbered by the leaves of the child.

    With factors of their own for its components, a leaf moves differently: its reports are made anew.
    """
    counts = [len(part.leaves) for part in together.parts]
    firsts = np.cumsum([0, *counts])
    kept = [int(firsts[i]) + k for i in fitted.used for k in range(counts[i])]
    if fitted.choice != "per component":
        return [
            report.model_copy(update={"leaf": kept.index(report.leaf)})
            for report in sorted(together.reports, key=lambda report: report.leaf)
            if report.leaf in kept
        ]
    taught = [motions for source in used for motions in source.artifact.demonstrations]
    origins = [leaf for source in used for leaf in source.skill.leaves]
    reports: list[DemonstrationReport] = []
    for number, (leaf, origin, motions) in enumerate(zip(fitted.skill.leaves, origins, taught, strict=True)):
        if motions is not None:
            moved = motions.translated(leaf.attractor - origin.attractor)
            reports += report_errors(leaf, moved, number)
    return reports


def _results(fitted: FittedMerger, together: Together) -> dict[str, Any]:
    results = together.results
    results["choice"] = fitted.choice
    for name, errors in (("errors", fitted.errors), ("held_out", fitted.held_out)):
        if errors is not None:
            results[name] = (errors.best_single, errors.equal, errors.fitted)
    return results


def _fit_operation(
    options: MergeOptions, task: TaskOptions, refit: bool, candidates: Sequence[str]
) -> Operation:
    """Return what decides the result; what came of it is not known yet."""
    chosen = {
        "target": options.target,
        "refit": refit,
        "fit_level": task.level,
        "from_store": task.from_store,
        CANDIDATES: candidates_digest(candidates),
    }
    reading = {key: value for key, value in asdict(task.reading).items() if value is not None}
    return Operation(command="merge", options={**reading, **chosen})


def _report(
    written: Written,
    sources: Sequence[Source],
    merged: MergedSkill,
    together: Together,
    certificate: Certificate,
    task: TaskReport | None = None,
    notes: tuple[str, ...] = (),
) -> MergeReport:
    return MergeReport(
        skill=written.skill,
        path=written.path,
        digest=written.digest,
        created=written.created,
        parts=summaries(sources, merged.part_weights.tolist()),
        gate=merged.gate,
        sharpness=merged.parameters.get("sharpness", 1.0),
        speed=merged.speed,
        attractor=tuple(merged.attractor.tolist()),
        unit=merged.space.unit,
        lyapunov=together.origin,
        refits=together.refits,
        task=task,
        rate=certificate.rate,
        period=certificate.period,
        notes=(*notes_on([source.skill for source in sources]), *together.notes, *notes),
    )
