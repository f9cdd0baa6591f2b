"""A skill on a simulated arm: one episode, its log, its picture and its film."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from skillctl.errors import require_directory
from skillctl.progress import Progress
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.draws import chosen
from skillctl.simulation.episode import Episode, Metrics, Outcome
from skillctl.simulation.recording import encode_log, log_format
from skillctl.simulation.run import simulate as run_episode
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.torque import TORQUE_PERIOD
from skillctl.stability.certificate import certify
from skillctl.stability.report import at_most
from skillctl.store import Lock, write_file
from skillctl.store.source import Source, open_skill


@dataclass(frozen=True)
class SimulateReport:
    """What happened on the arm.

    Attributes:
        skill, digest: What was run.
        outcome: How it ended, see ``Outcome``.
        success: Whether the target was reached, or the cup grasped.
        detail: For a failure, what happened; else empty.
        scenario: What was run, as in a scenario file; null: chosen automatically.
        arm, hand, base_yaw: Which arm, how it held its hand, how far its base was turned [rad].
        plane, scale, origin: Where the skill was placed: workspace = origin [m] + scale · coordinates.
        target: Workspace position the motion went to, [m].
        metrics: The figures, in SI units.
        wall_seconds: What the simulation cost.
        log, picture, video: Files written, if any.
        notes: What the success or failure does not show.
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
    store: str | Path | None = None,
    lock: Lock | None = None,
    progress: Progress | None = None,
) -> SimulateReport:
    """Run a skill on a simulated arm.

    Args:
        reference: The skill.
        scenario: Arm, placement, start, target, limits.
        demo: Start where this embedded demonstration starts, counted from 0; if the target is moved, as far
            from it as the demonstration was. (The cup as target moves no start.)
        episode: Run this one of the episodes that the scenario draws, counted from 0.
        log: Write the time series there, ``.csv`` or ``.h5``.
        picture: Write a contact sheet there, as PNG.
        video: Write a film there, ``.gif`` or ``.mp4``.
        gui: Show it in a window, in real time.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        progress: Called with (stage, milliseconds done, milliseconds at most).

    Raises:
        NotFoundError: No such skill, PyBullet is not installed, or PyAV for an ``.mp4``.
        UsageError: A start, target or placement that makes no sense for this skill.
        GoalNotReachedError: Start or target is out of the arm's reach.
    """
    source = open_skill(reference, store, lock)
    taught = source.artifact.demonstrations
    scenario = chosen(source.skill, taught, scenario or Scenario(), demo=demo, episode=episode)
    _require_writable(log, picture, video)
    result = run_episode(source.skill, scenario, progress=_in_milliseconds(progress), gui=gui)
    if log is not None:
        write_file(log, encode_log(result, log_format(log.name)))
    if picture is not None:
        from skillctl.simulation.picture import encode_picture  # late: only pictures need Pillow

        if progress is not None:
            progress("drawing", 0, 1)
        write_file(picture, encode_picture(result, title=source.name))
    if video is not None:
        from skillctl.simulation.video import encode_video, film_format

        drawn = None if progress is None else partial(progress, "filming")
        write_file(video, encode_video(result, film_format(video.name), progress=drawn))
    return _report(source, result, log, picture, video)


def _require_writable(log: Path | None, picture: Path | None, video: Path | None) -> None:
    """Refuse files that could not be written, before anything is run for them."""
    require_directories(log, picture, video)
    if log is not None:
        log_format(log.name)
    if video is not None:
        from skillctl.simulation.video import film_format

        film_format(video.name)


def _in_milliseconds(progress: Progress | None) -> Callable[[float, float], None] | None:
    if progress is None:
        return None
    return lambda now, end: progress("moving", int(1e3 * now), int(1e3 * end))


def _report(
    source: Source, episode: Episode, log: Path | None, picture: Path | None, video: Path | None
) -> SimulateReport:
    placement = episode.placement
    return SimulateReport(
        skill=source.name,
        digest=source.artifact.digest,
        outcome=episode.outcome,
        success=episode.success,
        detail=episode.detail,
        scenario=episode.scenario.model_dump(),
        arm=episode.arm.name,
        hand=episode.hand,
        base_yaw=episode.base_yaw,
        plane=placement.plane,
        scale=placement.scale,
        origin=tuple(placement.origin.tolist()),
        target=tuple(episode.target.tolist()),
        metrics=episode.metrics,
        wall_seconds=episode.wall_seconds,
        log=log,
        picture=picture,
        video=video,
        notes=proof_notes(source, episode.scenario.control),
    )


def proof_notes(source: Source, control: str) -> tuple[str, ...]:
    """Return what the proof of a skill asks for that a simulated controller does not give."""
    period = certify(source.skill, digest=source.artifact.digest).period
    simulated = TORQUE_PERIOD if control == "torque" else CONTROL_PERIOD
    if period is None or period >= simulated:
        return ()
    return (
        f"the proof of {source.name} asks for a controller at {at_most(1 / period)} Hz or faster; "
        f"this one runs at {1 / simulated:.0f} Hz.",
    )


def require_directories(*files: Path | None) -> None:
    """Refuse files whose directory does not exist, before anything is run for them."""
    for file in files:
        require_directory(file)
