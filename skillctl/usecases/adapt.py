"""Adapt skills to a task: search, prove, judge, and write what does it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from skillctl.adapt.asked import AskedTask
from skillctl.adapt.candidates import newest_of_store
from skillctl.adapt.report import TaskVerdict
from skillctl.adapt.search import Candidate, Search, search_robustly, shortlist
from skillctl.adapt.task_file import Task, task_of_demonstrations, task_of_scenario, to_toml
from skillctl.adapt.together import Refit, Together, prove_together
from skillctl.compose.merge import common_members
from skillctl.compose.options import MergeOptions
from skillctl.compose.parts import require_no_chains
from skillctl.demonstrations.options import Reading
from skillctl.errors import FitError, UsageError
from skillctl.model.skill import ActingSkill
from skillctl.plotting.formats import require_picture
from skillctl.progress import Progress
from skillctl.simulation.scenario_file import read_scenario
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Artifact, Lock, Operation, existing_store
from skillctl.store.source import Source, carried_reports, open_skill
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.make import (
    CANDIDATES,
    PartSummary,
    Request,
    candidates_digest,
    child_artifact,
    make,
    reports_on,
    require_stable,
)

LISTED = 12  # candidates that a report has


@dataclass(frozen=True)
class ClauseResult:
    """One clause of the task, and what came of it.

    Attributes:
        clause, unit: Its name, and the unit of the margins.
        margin: Of the result, the smallest over all starts; negative: it fails.
        proved: Whether it is proved for all starts in the box.
        bound: The margin that is proved; None if nothing can be proved of it.
        single, equal: Margins of the best single skill, and of all parts with equal weights; None if there
            is no such thing, or the skill was there already and does not say.
    """

    clause: str
    unit: str
    margin: float
    proved: bool
    bound: float | None
    single: float | None
    equal: float | None


@dataclass(frozen=True)
class CandidateResult:
    """One skill that was tried.

    Attributes:
        kind: ``single``, ``merged`` or ``combined``.
        gate: How its parts act together; empty for a single skill.
        weights: Of the skills to choose from, in their order.
        score: Worst margin over clauses and starts, each in its scale, and a little of the mean.
        worst: Name of the clause with the worst margin in its scale.
        margin: That margin, in the unit of the clause.
    """

    kind: str
    gate: str
    weights: tuple[float, ...]
    score: float
    worst: str
    margin: float


@dataclass(frozen=True, kw_only=True)
class AdaptReport:
    """What ``adapt`` did.

    Attributes:
        status: ``adapted``; ``up to date``: the same task and skills gave what is there; ``not adapted``: a
            clause fails, and nothing was written.
        holds: Whether every clause holds.
        failures: The clauses that fail, in sentences.
        written: How to name the skill, where it is, what it is; None if nothing was written.
        certificate: What is proved of it.
        task: Digest of the task.
        choice: What it is: ``single``, ``merged``, ``merged per component`` or ``combined``.
        gate, speed: How its parts act together, and how much faster than they.
        parts: What it was made of; shares are the weights.
        clauses: Each clause with its margins.
        starts, held: Starts that were drawn to judge it, and from how many every clause holds.
        interval: Wilson's interval of that share, of 95 %.
        skills: The skills to choose from, in the order of the candidates' weights.
        candidates: The best that were tried, the best first; none if it was up to date.
        tried: How many were tried.
        refits: Leaves that were learned again for a common proof, if any.
        unit: Of the space.
        notes: Sentences for the user.
        warnings: Sentences on what is wrong with what it was made from.
        reasons: Why it was made, in words; empty if it was up to date.
    """

    status: str
    holds: bool
    failures: tuple[str, ...]
    written: Written | None
    certificate: Certificate
    task: str
    choice: str
    gate: str
    speed: float
    parts: tuple[PartSummary, ...]
    clauses: tuple[ClauseResult, ...]
    starts: int
    held: int
    interval: tuple[float, float]
    skills: tuple[str, ...]
    candidates: tuple[CandidateResult, ...]
    tried: int
    refits: tuple[Refit, ...]
    unit: str
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Details:
    """More for the report."""

    found: Search
    verdict: TaskVerdict
    together: Together | None
    notes: tuple[str, ...]


def adapt(
    task: Task | Path,
    skills: Sequence[str | Path] = (),
    *,
    from_store: bool = False,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    lock: Lock | None = None,
    note: str | None = None,
    refit: bool = True,
    anyway: bool = False,
    force: bool = False,
    plot: Path | None = None,
    progress: Progress | None = None,
) -> AdaptReport:
    """Find, among skills, their mergers and combinations, one that does a task; prove it, and write it.

    Args:
        task: The task, or its file.
        skills: References to the skills to choose from.
        from_store: Choose from all skills of the store instead.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        note: To be kept in the skill.
        refit: Learn parts again from their embedded demonstrations if no common Lyapunov matrix exists.
        anyway: Write the best candidate even if a clause fails.
        force: Make it even if the same task and skills gave what is there.
        plot: Draw the task and the motions there; the suffix decides the format.
        progress: Called with (stage, done, total).

    Raises:
        UsageError: Options that do not go together, or a task in another space than the skills.
        NotFoundError, InputDataError, ArtifactError: A file does not exist, or cannot be used.
        FitError: No skill can do anything towards the task, or no proof was found.
    """
    if plot is not None:
        require_picture(plot)
    request = Request(Destination.at(output, name, store, note), force)
    asked = AskedTask.read(task, store, lock)
    sources, notes = _sources(skills, asked, from_store, request.destination, lock)
    options: dict[str, Any] = {
        "task": asked.task.digest,
        "from_store": from_store,
        "refit": refit,
        "like": asked.digests,
        CANDIDATES: candidates_digest(source.artifact.digest for source in sources),
    }
    operation = Operation(command="adapt", options=options)

    def build() -> tuple[Artifact, Certificate, _Details]:
        return _built(asked, _shortlisted(sources, asked), operation, refit, notes, progress)

    known = {source.artifact.digest: source for source in sources}
    made = make(
        request,
        operation,
        build,
        inputs=[path for path, _ in asked.inputs],
        parents=None,
        fits=lambda there: {record.digest for record in there.provenance.parents} <= known.keys(),
    )
    details, artifact = made.details, made.artifact
    verdict = details.verdict if details else asked.judged(artifact.skill, made.certificate)
    fields: dict[str, Any] = {"status": "not adapted", "written": None, "certificate": made.certificate}
    if verdict.holds or anyway or made.current is not None:
        fields = made.write(request.destination, "adapted")
    if plot is not None:
        from skillctl.usecases.pictures import picture_task  # late: only pictures need Matplotlib

        picture_task(asked, artifact.skill, plot)
    used = [known[record.digest] for record in artifact.provenance.parents]
    shares = artifact.skill.shares.tolist() or [1.0]
    results: Mapping[str, Any] = artifact.operation.results
    return AdaptReport(
        **{"warnings": (), "reasons": made.reasons, **fields},
        holds=verdict.holds,
        failures=verdict.failures,
        task=asked.task.digest,
        choice=results["choice"],
        gate=artifact.skill.gate,
        speed=results["speed"],
        parts=tuple(
            PartSummary(source.name, source.artifact.digest, share, source.skill.n_components)
            for source, share in zip(used, shares if len(shares) == len(used) else [1.0], strict=True)
        ),
        clauses=_clauses(verdict, results),
        starts=verdict.starts,
        held=verdict.held,
        interval=verdict.interval,
        skills=tuple(source.name for source in sources),
        candidates=_listed(details.found) if details else (),
        tried=len(details.found.candidates) if details else 0,
        refits=details.together.refits if details and details.together else (),
        unit=artifact.skill.space.unit,
        notes=(*notes, *(details.notes if details else ())),
    )


def print_task(paths: Sequence[Path]) -> str:
    """Return a task file for demonstrations, or for one scenario with a target and starts.

    Raises:
        NotFoundError, InputDataError: A file cannot be used.
        UsageError: A scenario that lacks a target or starts, or that is not alone.
    """
    if not any(path.suffix == ".toml" for path in paths):
        read = Reading().read(paths)
        return to_toml(task_of_demonstrations(read.demonstrations, tuple(map(str, paths))))
    if len(paths) > 1:
        raise UsageError("print-task: one scenario, or demonstrations, not both.", hint="Name one scenario.")
    return to_toml(task_of_scenario(read_scenario(paths[0])))


def _sources(
    skills: Sequence[str | Path],
    asked: AskedTask,
    from_store: bool,
    destination: Destination,
    lock: Lock | None,
) -> tuple[list[Source], tuple[str, ...]]:
    """Return the skills to choose from, and notes on those that cannot be read."""
    if from_store == bool(skills):
        raise UsageError(
            "skills and --from-store exclude each other." if skills else "adapt: no skill is named.",
            hint="Name skills, or let all of the store take part with --from-store.",
        )
    if not from_store:
        sources = [open_skill(reference, destination.store, lock) for reference in skills]
        if len(_spaces(sources)) > 1:
            raise UsageError(
                "adapt: the skills have different coordinates, units or frames.",
                hint="Learn them again with the same columns, units and frame.",
            )
        require_no_chains([source.skill for source in sources], "adapt")
        return sources, ()
    size = len(asked.task.target.position)
    root = existing_store(destination.store)
    readable, notes = newest_of_store(root, lock, but=destination.name)
    acting = [source for source in readable if isinstance(source.skill, ActingSkill)]
    sources = [s for s in acting if size in s.skill.space.sizes]
    if not sources or len(_spaces(sources)) > 1:
        raise FitError(
            f"the store {root} has {len(sources)} skills that are not combined and have {size} coordinates"
            + (", in different units or frames." if sources else "."),
            hint="Learn skills in the coordinates of the task, or name them.",
        )
    return sources, notes


def _spaces(sources: Sequence[Source]) -> set[tuple[object, ...]]:
    """Return what states of the skills are; of poses without the length, which is made one for all."""
    spaces = [source.skill.space for source in sources]
    return {(space.kind, space.names, space.unit, space.frame) for space in spaces}


def _shortlisted(sources: list[Source], asked: AskedTask) -> list[Source]:
    """Return the few skills that help most; all if there are few."""
    chosen = shortlist(asked.task, [s.skill for s in sources], shown=asked.shown, like=asked.like)
    return [sources[i] for i in chosen]


def _built(
    asked: AskedTask,
    sources: Sequence[Source],
    operation: Operation,
    refit: bool,
    notes: Sequence[str],
    progress: Progress | None,
) -> tuple[Artifact, Certificate, _Details]:
    """Search, prove and judge."""
    together, said = _together(sources, refit, progress)
    parts = None if together is None else common_members(together.parts, together.lyapunov)
    found = search_robustly(asked.task, [s.skill for s in sources], parts, shown=asked.shown, like=asked.like)
    best = found.best
    skill = best.build()
    certificate = require_stable(certify(skill))
    verdict = asked.judged(skill, certificate)
    used = [sources[i] for i in best.parts]
    refitted = together is not None and bool(together.refits) and best.kind == "merged"
    inputs = [record for _, record in asked.inputs]
    artifact = child_artifact(skill, used, operation, carried_reports(used), inputs)
    if refitted or best.component_wise or best.speed != 1:  # the leaves move differently than before
        artifact = replace(artifact, reports=reports_on(artifact))
    compared = [
        None if c is None else asked.judged(c.build(), certificate) for c in (found.single, found.equal)
    ]
    done = operation.model_copy(update={"results": _results(asked.task, best, verdict, compared)})
    impossible = [
        f"{name} fails at the target itself, by {-most:.3g} m: no motion that arrives keeps it."
        for name, most in found.judge.at_target.items()
        if most < 0
    ]
    details = _Details(found, verdict, together, (*said, *impossible))
    return replace(artifact, operation=done), certificate, details


def _together(
    sources: Sequence[Source], refit: bool, progress: Progress | None
) -> tuple[Together | None, tuple[str, ...]]:
    """Return the acting skills under one P, and a note if there is none, so that they cannot be merged."""
    if len(sources) < 2:
        return None, ()
    if not all(isinstance(source.skill, ActingSkill) for source in sources):
        return None, ("a combined skill is among the skills: nothing was merged.",)
    try:
        together = prove_together(sources, MergeOptions().merge, refit=refit, progress=progress)
    except FitError as error:
        return None, (f"nothing was merged: {error}",)
    return together, together.notes


def _results(
    task: Task, best: Candidate, verdict: TaskVerdict, compared: Sequence[TaskVerdict | None]
) -> dict[str, Any]:
    """Return what a skill keeps of how it was adapted: the task, and the margins of its clauses."""
    single, equal = (
        None if other is None else tuple(each.margin for each in other.clauses) for other in compared
    )
    clauses = verdict.clauses
    return {
        "choice": f"{best.kind} per component" if best.component_wise else best.kind,
        "speed": best.speed,
        "task": tuple(to_toml(task).splitlines()),
        "clauses": tuple(each.clause for each in clauses),
        "units": tuple(each.unit for each in clauses),
        "margins": tuple(each.margin for each in clauses),
        "bounds": tuple(each.bound for each in clauses),
        "single_margins": single,
        "equal_margins": equal,
        "starts": verdict.starts,
        "held": verdict.held,
    }


def _clauses(verdict: TaskVerdict, results: Mapping[str, Any]) -> tuple[ClauseResult, ...]:
    count = len(verdict.clauses)
    single, equal = (results[f"{key}_margins"] or (None,) * count for key in ("single", "equal"))
    return tuple(
        ClauseResult(each.clause, each.unit, each.margin, each.proved, each.bound, one, all_)
        for each, one, all_ in zip(verdict.clauses, single, equal, strict=True)
    )


def _listed(found: Search) -> tuple[CandidateResult, ...]:
    """Return the best candidates, the best of each kind among them."""
    kinds = {
        kind: next((c for c in found.candidates if c.kind == kind), None)
        for kind in ("single", "merged", "combined")
    }
    chosen = [*found.candidates[:LISTED], *(c for c in kinds.values() if c is not None)]
    seen, listed = set(), []
    for candidate in chosen:
        if id(candidate) in seen:
            continue
        seen.add(id(candidate))
        scaled = {name: value / found.judge.scales[name] for name, value in candidate.worst.items()}
        worst = min(scaled, key=lambda name: scaled[name])
        listed.append(
            CandidateResult(
                candidate.kind,
                candidate.gate,
                tuple(candidate.weights.tolist()),
                candidate.score,
                worst,
                candidate.worst[worst],
            )
        )
    return tuple(listed)
