"""What is proved of skills, re-derived from their stored numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from skillctl.adapt.report import TaskVerdict
from skillctl.errors import SkillctlError, StoreError, UsageError
from skillctl.evaluate.coverage import demonstrated_starts
from skillctl.geometry import box
from skillctl.model.golden import GoldenComparison
from skillctl.model.skill import Skill
from skillctl.progress import Progress
from skillctl.simulation.prepare import among_scene
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scenario_file import read_scenario
from skillctl.stability.certificate import certify
from skillctl.stability.clearance import Clearance, clearance
from skillctl.stability.reach import Reach, bound_reach
from skillctl.stability.report import Certificate
from skillctl.stability.requirements import DEMOS, Requirements
from skillctl.store import Lock, locate_store
from skillctl.store.signing import SignatureState
from skillctl.store.source import Source, open_skill
from skillctl.usecases.c99 import exported_from
from skillctl.usecases.sign import check_signature
from skillctl.workers import WorkerDied, Workers

if TYPE_CHECKING:
    from skillctl.adapt.asked import AskedTask

NOTHING_RECORDED = "It holds no golden motions: an earlier version made it, or no period is proved of it."
Outcome: TypeAlias = Literal["proved", "not proved", "not signed", "inconclusive", "unreadable"]


@dataclass(frozen=True)
class SkillVerdict:
    """What is known of one skill: a certificate, or why it could not be read.

    Attributes:
        skill: Its name, with its version if it is from the store; of a header in C, the file before it.
        path: Its file; None if it could not be read.
        digest: Content digest that the certificate holds for.
        certificate: What is proved; None if the skill could not be read.
        error: Why it could not be read.
        outcome: ``proved``: everything that is required. ``not proved``: something is not, or is refuted.
            ``inconclusive``: neither a proof nor a witness for the required scope. ``not signed``: nothing is
            refuted, but the required signature is not valid. ``unreadable``: see ``error``.
        unmet: The requirements that are not met, and the clauses of the task that fail, in sentences.
        signature: State of the required signature; None if none is required.
        reach: Where its motions from the start box go, and when they arrive; None if no box was given, or if
            nothing is proved of them.
        clearance: Which bodies of the scene its hand is proved clear of; None if no scene was given.
        task: How it does the task; None if no task was given.
        golden: How it agrees with its golden motions; None if that was not asked, or if it holds none.
    """

    skill: str
    path: Path | None = None
    digest: str | None = None
    certificate: Certificate | None = None
    error: SkillctlError | None = None
    outcome: Outcome = "unreadable"
    unmet: tuple[str, ...] = ()
    signature: SignatureState | None = None
    reach: Reach | None = None
    clearance: Clearance | None = None
    task: TaskVerdict | None = None
    golden: GoldenComparison | None = None


@dataclass(frozen=True)
class VerifyReport:
    """The verdicts, in the order in which the skills were named, and what was required.

    Attributes:
        skills: One verdict each.
        required: Of the proof.
        golden: Whether they had to agree with their golden motions.
    """

    skills: tuple[SkillVerdict, ...]
    required: Requirements
    golden: bool = False


def verify_stability(
    references: Sequence[str | Path],
    *,
    store: str | Path | None = None,
    lock: Lock | None = None,
    required: Requirements | None = None,
    scene: Path | None = None,
    task: Path | None = None,
    golden: bool = False,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> VerifyReport:
    """Return what is proved of each skill; one that cannot be read does not keep others from being checked.

    Args:
        references: Files, or names of the store; of a header in C, the skill that it was exported from.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        required: What has to be proved; by default convergence from everywhere.
        scene: A scenario file: of which of its bodies is the hand proved clear?
        golden: Every skill has to agree with the motions that were recorded where it was made.
        task: A task file; every skill has to do the task as it is, by all motions that are followed.
        workers: Processes that read and prove; by default this one. They do not change a verdict.
        progress: Called with (outcome of one skill, skills done, skills in all).

    Raises:
        NotFoundError: There is no such cluster.
        StoreError: The cluster was lost.
        UsageError: A box of another dimension than a skill, ``demos`` for a skill without demonstrations, or
            a skill that a scene means nothing to.
        InputDataError: The scenario file cannot be used.
    """
    required = required or Requirements()
    named, finished = [str(reference) for reference in references], 0

    def done(position: int, verdict: SkillVerdict | WorkerDied) -> None:
        nonlocal finished
        finished += 1
        if progress is not None:
            outcome = "unreadable" if isinstance(verdict, WorkerDied) else verdict.outcome
            progress(f"{named[position]} {outcome}", finished, len(named))

    def waiting(words: str) -> None:
        if progress is not None:
            progress(words, finished, len(named))

    workers = workers or Workers()
    # The surroundings of this process decide where the store is, not those of a worker.
    place = store if workers.scheduler is None else locate_store(store)
    scenario = None if scene is None else read_scenario(scene)
    asked = None
    if task is not None:
        from skillctl.adapt.asked import AskedTask  # late: it reads demonstrations, and scenes

        asked = AskedTask.read(task, place, lock)
    work = partial(
        _verdict, store=place, lock=lock, required=required, scenario=scenario, asked=asked, golden=golden
    )
    verdicts = workers.run(work, named, done=done, waiting=waiting)
    return VerifyReport(
        tuple(
            _died(reference) if isinstance(verdict, WorkerDied) else verdict
            for reference, verdict in zip(named, verdicts, strict=True)
        ),
        required,
        golden,
    )


def verify(skill: Skill | str | Path, *, store: str | Path | None = None) -> Certificate:
    """Return what is proved of one skill, given as such or by reference.

    Args:
        skill: A skill; or a file, or a name of the store.
        store: Where names live; default as on the command line.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill.
    """
    if isinstance(skill, Skill):
        return certify(skill)
    source = open_skill(skill, store)
    return certify(source.skill, digest=source.artifact.digest)


def _died(reference: str) -> SkillVerdict:
    error = StoreError(
        f"{reference}: the process that checked it died: it was killed, or there was no memory left.",
        hint="Check it by itself, or use fewer --jobs.",
    )
    return SkillVerdict(reference, error=error)


def _verdict(
    reference: str,
    store: str | Path | None,
    lock: Lock | None,
    required: Requirements,
    scenario: Scenario | None,
    asked: AskedTask | None,
    golden: bool,
) -> SkillVerdict:
    try:
        skill = exported_from(reference, store)
        source = open_skill(skill, store, lock)
        signed = None if required.signer is None else check_signature(source, required.signer)
    except SkillctlError as error:
        return SkillVerdict(reference, error=error)
    digest = source.artifact.digest
    certificate = certify(source.skill, digest=digest, period=required.period)
    reach = _reach(source, certificate, required)
    unmet = required.unmet_by(certificate, reach)
    task = None if asked is None else asked.judged(source.skill, certificate)
    unmet = (*unmet, *(() if task is None else task.failures))
    outcome: Outcome = "proved"
    if unmet:
        unknown = certificate.verdict == "inconclusive" and not required.reached_by(certificate)
        outcome = "inconclusive" if unknown else "not proved"
    agreement = _agreement(source) if golden else None
    if golden and agreement is None:
        unmet = (*unmet, NOTHING_RECORDED)
        outcome = "inconclusive" if outcome == "proved" else outcome
    elif agreement is not None and not agreement.agrees:
        unmet = (*unmet, f"It does not agree with its golden motions: {agreement.said}.")
        outcome = "not proved"
    if signed is not None and signed.state != "valid":
        unmet = (*unmet, f"Required is a signature; {signed.explanation}")
        outcome = "not proved" if outcome == "not proved" else "not signed"
    state = None if signed is None else signed.state
    path = source.located.path
    clear = None if scenario is None else _clearance(source, scenario, required)
    name = source.name if skill == reference else f"{reference}, of {source.name}"
    return SkillVerdict(
        name, path, digest, certificate, None, outcome, unmet, state, reach, clear, task, agreement
    )


def _agreement(source: Source) -> GoldenComparison | None:
    golden = source.artifact.golden
    return None if golden is None else golden.compared(source.skill)


def _clearance(source: Source, scenario: Scenario, required: Requirements) -> Clearance:
    """Return which bodies of a scene the hand of a skill, moved to the scene's target, is proved clear of."""
    among = among_scene(source.skill, scenario)
    reach = _reach(source, certify(among.skill), required, among.skill)
    return clearance(among.skill, among.avoided, among.others, reach)


def _reach(
    source: Source, certificate: Certificate, required: Requirements, skill: Skill | None = None
) -> Reach | None:
    """Return the bounds of motions from the required start box, if there is one and they are proved.

    They are those of the skill itself, or of what has become of it in a scene.
    """
    skill = source.skill if skill is None else skill
    space = source.skill.space
    names = space.names[: space.positions]
    for option, ranges in (("start-box", required.start_box), ("stay-in", required.stay_in)):
        if ranges is not None and ranges != DEMOS and len(ranges) != len(names):
            raise UsageError(
                f"{option}: expected a range for each coordinate of {source.name} ({', '.join(names)}), "
                f"got {len(ranges)}."
            )
    if required.start_box is None:
        return None
    if required.start_box == DEMOS:
        starts = demonstrated_starts(source.skill, source.artifact.demonstrations)
        if not len(starts):
            raise UsageError(
                f"start-box: {source.name} carries no demonstrations.",
                hint="Give the ranges of its coordinates.",
            )
        return bound_reach(skill, certificate, *box(starts[:, : len(names)]), period=required.period)
    low, high = zip(*required.start_box, strict=True)
    return bound_reach(skill, certificate, low, high, period=required.period)
