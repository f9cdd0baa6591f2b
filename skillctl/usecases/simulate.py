"""A skill on a simulated arm: one episode, its log, its picture and its film."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from skillctl.adapt.asked import AskedTask
from skillctl.adapt.report import TaskVerdict
from skillctl.errors import UsageError, require_directory
from skillctl.model.skill import Skill
from skillctl.progress import Progress
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.batch import Adapt
from skillctl.simulation.draws import chosen
from skillctl.simulation.episode import PHASES, Episode, Metrics, Outcome, StageTime, Unit
from skillctl.simulation.recording import encode_log, log_format
from skillctl.simulation.run import simulate as run_episode
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.torque import TORQUE_PERIOD
from skillctl.stability.certificate import certify
from skillctl.stability.report import least_frequency
from skillctl.store import Lock, write_file
from skillctl.store.source import Source, open_skill

TASK_ROWS = (
    12  # between two measured places that a task is judged by: 50 ms, in which jitter has no direction
)


@dataclass(frozen=True)
class SimulateReport:
    """The result of one episode.

    Attributes:
        skill, digest: The skill that was run.
        outcome: How the episode ended, see ``Outcome``.
        success: Whether the hand reached the target, or grasped the cup.
        detail: What happened, for a failure; else empty.
        scenario: The scenario, as in a file; what is null was chosen automatically.
        arm, hand, base_yaw: The arm, the orientation of its hand, the turn of its base [rad].
        tip, held: The link that is the hand, and the joints of an arm by file that do not move and where they
            stay, [rad] or [m].
        plane, scale, origin: The placement: workspace = origin [m] + scale · coordinates.
        target: Workspace position of the target, [m]; its joints for a skill that moves joints.
        target_turn: Orientation q_xyzw of the target of a pose skill.
        task: How the measured motion, until a lift begins, does the task; None if none was given.
        stages: When the stages of a chain acted.
        unit: Unit of target, final error and tracking: ``m``, or ``rad``.
        metrics: The figures, in SI units.
        wall_seconds: Time that the simulation took, [s].
        log, picture, video: Files that were written, if any.
        notes: What the outcome does not show, and what was not taken from the file of an arm.
    """

    skill: str
    digest: str
    outcome: Outcome
    success: bool
    detail: str
    scenario: dict[str, Any]
    arm: str
    hand: str
    base_yaw: float
    plane: str | None
    scale: float
    origin: tuple[float, ...]
    target: tuple[float, ...]
    metrics: Metrics
    wall_seconds: float
    log: Path | None
    picture: Path | None
    video: Path | None
    notes: tuple[str, ...]
    tip: str
    held: dict[str, float]
    unit: Unit
    target_turn: tuple[float, ...] | None = None
    task: TaskVerdict | None = None
    stages: tuple[StageTime, ...] = ()


def simulate(
    reference: str | Path,
    scenario: Scenario | None = None,
    *,
    demo: int | None = None,
    episode: int | None = None,
    log: Path | None = None,
    picture: Path | None = None,
    video: Path | None = None,
    gui: bool = False,
    task: Path | None = None,
    store: str | Path | None = None,
    lock: Lock | None = None,
    progress: Progress | None = None,
) -> SimulateReport:
    """Run a skill on a simulated arm.

    Args:
        reference: The skill.
        scenario: Arm, placement, start, target, limits.
        demo: Number, from 0, of the embedded demonstration whose start is used; a target that is moved by
            coordinates moves this start too.
        episode: Number, from 0, of the one episode to run of those that the scenario draws.
        log: File for the time series, ``.csv`` or ``.h5``.
        picture: File for a contact sheet, PNG.
        video: File for a film, ``.gif`` or ``.mp4``.
        gui: Show the episode in a window, in real time.
        task: A task file: the episode is a success only if its motion fulfils every clause, too.
        store: The store of names; default as on the command line.
        lock: Allow only skills that it names.
        progress: Called with a stage, and how much of it is done: milliseconds of motion, or frames.

    Raises:
        NotFoundError: No such skill, PyBullet is not installed, or PyAV for an ``.mp4``.
        UsageError: A start, target or placement that does not fit this skill.
        GoalNotReachedError: Start or target is out of the arm's reach.
    """
    source = open_skill(reference, store, lock)
    asked = None if task is None else AskedTask.read(task, store, lock)
    taught = source.artifact.demonstrations
    scenario = chosen(source.skill, taught, scenario or Scenario(), demo=demo, episode=episode)
    files = _files(source.name, log, picture, video, progress)
    skill, weighed = adapted_to(scenario, source.skill)
    result = run_episode(skill, scenario, progress=progress, gui=gui)
    for path, encode in files:
        if progress is not None:
            progress("drawing", 0, 1)
        write_file(path, encode(result))
    setup, placement = result.setup, result.setup.placement
    judged = None if asked is None else _judged(asked, result)
    return SimulateReport(
        skill=source.name,
        digest=source.artifact.digest,
        outcome=result.outcome,
        success=result.success and (judged is None or judged.holds),
        detail=result.detail,
        scenario=scenario.model_dump(),
        arm=setup.arm.name,
        hand=setup.hand,
        base_yaw=setup.base_yaw,
        plane=placement.plane,
        scale=placement.scale,
        origin=tuple(placement.origin.tolist()),
        target=tuple((setup.joint_plan.target if setup.joint_plan else result.target).tolist()),
        metrics=result.metrics,
        wall_seconds=result.wall_seconds,
        log=log,
        picture=picture,
        video=video,
        notes=(
            *weighed,
            *setup.arm.notes,
            *filter(None, [setup.avoided]),
            *proof_notes(source, scenario.control),
        ),
        tip=setup.arm.tip_link,
        held=dict(setup.arm.held),
        unit=setup.unit,
        target_turn=tuple(result.series.target_turns[-1].tolist()) if setup.turns else None,
        task=judged,
        stages=result.stages,
    )


def _judged(asked: AskedTask, episode: Episode) -> TaskVerdict:
    """Return whether the measured motion of the hand, until it lifts something, does a task.

    Raises:
        UsageError: The skill moves joints.
    """
    setup, series = episode.setup, episode.series
    if setup.joint_plan is not None:
        raise UsageError("task: it is about places of the hand; this skill moves joints.")
    moved = series.hand[series.phases < PHASES.index("lift")]
    states = setup.placement.to_state(moved[::TASK_ROWS])
    step = TASK_ROWS * float(series.times[1] - series.times[0])
    return asked.judged_path(setup.skill, states, step)


def _files(
    name: str, log: Path | None, picture: Path | None, video: Path | None, progress: Progress | None
) -> list[tuple[Path, Callable[[Episode], bytes]]]:
    """Return the files to write, each with the function that encodes an episode.

    This is called before the run, so that a file that cannot be written costs no simulation.
    """
    require_directories(log, picture, video)
    files: list[tuple[Path, Callable[[Episode], bytes]]] = []
    if log is not None:
        files.append((log, partial(encode_log, kind=log_format(log.name))))
    if picture is not None:
        from skillctl.simulation.picture import encode_picture  # late: only pictures need Pillow

        files.append((picture, partial(encode_picture, title=name)))
    if video is not None:
        from skillctl.simulation.video import encode_video, film_format

        files.append((video, partial(encode_video, kind=film_format(video.name), progress=progress)))
    return files


def adapting(scenario: Scenario, skill: Skill) -> Adapt | None:
    """Return what adapts a skill to an episode, None if the scenario does not ask for it.

    Raises:
        UsageError: It does, and the weights of this skill cannot be chosen.
    """
    if not scenario.adapt:
        return None
    from skillctl.adapt.per_target import adapted, require_merged  # late: most runs do not adapt

    require_merged(skill)
    return adapted


def adapted_to(scenario: Scenario, skill: Skill) -> tuple[Skill, tuple[str, ...]]:
    """Return the skill that runs in the scenario of one episode, and a sentence if its weights were chosen.

    Raises:
        UsageError: They were to be, and those of this skill cannot be.
    """
    if not scenario.adapt:
        return skill, ()
    from skillctl.adapt.per_target import Weighing  # late, as in ``adapting``
    from skillctl.compose.merge import with_weights

    weighing = Weighing.of(skill, scenario)
    weights = weighing.chosen()
    said = ", ".join(f"{weight:.3g}" for weight in weights)
    return with_weights(weighing.skill, weights), (f"weights chosen for this target and scene: {said}.",)


def proof_notes(source: Source, control: str) -> tuple[str, ...]:
    """Return a note if the proof of a skill needs a faster controller than the simulated one."""
    period = certify(source.skill, digest=source.artifact.digest).period
    simulated = TORQUE_PERIOD if control == "torque" else CONTROL_PERIOD
    if period is None or period >= simulated:
        return ()
    return (
        f"the proof of {source.name} needs a controller at {least_frequency(period)} Hz or faster; "
        f"this one runs at {1 / simulated:.0f} Hz.",
    )


def require_directories(*files: Path | None) -> None:
    """Raise StoreError for a file whose directory does not exist."""
    for file in files:
        require_directory(file)
