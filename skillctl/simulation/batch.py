"""Many episodes of one scenario: each is drawn, and runs in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

from skillctl.arrays import FloatArray
from skillctl.errors import GoalNotReachedError
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill
from skillctl.progress import Progress
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.draws import drawn
from skillctl.simulation.episode import (
    OUTCOMES,
    PHASES,
    SUCCESSES,
    Episode,
    Metrics,
    Outcome,
    RefusedError,
    spread_out,
)
from skillctl.simulation.options import HandPolicy, Plane
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.workers import WorkerDied, Workers

Adapt: TypeAlias = Callable[[Skill, Scenario], Skill]
PATH_SPACING = 4e-3  # [m]: as fine as an overview can show

BatchOutcome: TypeAlias = Outcome | Literal["crashed"]
BATCH_OUTCOMES: tuple[BatchOutcome, ...] = (*OUTCOMES, "crashed")


@dataclass(frozen=True, eq=False, slots=True)
class Trace:
    """What an overview shows of an episode.

    Attributes:
        arm, hand, base_yaw: The arm, the orientation of its hand, how far its base is turned [rad].
        plane: Plane of a 2-D skill.
        joints, fingers: Its posture at the start, shapes (n,) and (m,).
        path: Positions of the hand, shape (k, 3), [m].
        turns: Its orientations there, q_xyzw, shape (k, 4), if the skill turns it; else none, shape (0, 4).
        cup: Pose of the cup at the start, (7,); NaN without a cup.
        target: Target of the motion, shape (3,), [m].
        part: Part of a combined skill that acted at the start.
        avoided: What of the scene the hand keeps out of; see ``Setup``.
    """

    arm: ArmModel
    hand: HandPolicy
    base_yaw: float
    plane: Plane | None
    joints: FloatArray
    fingers: FloatArray
    path: FloatArray
    turns: FloatArray
    cup: FloatArray
    target: FloatArray
    part: int
    avoided: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """One episode of a batch.

    Attributes:
        index: Its number, from 0.
        scenario: The scenario that was drawn; run by itself, it gives the same episode again.
        outcome: That of the episode, or ``crashed``: its process died or was killed.
        detail: What happened, for a failure.
        metrics, trace: None if the episode could not begin, or crashed.
    """

    index: int
    scenario: Scenario
    outcome: BatchOutcome
    detail: str
    metrics: Metrics | None
    trace: Trace | None

    @property
    def success(self) -> bool:
        """Whether the target was reached, or the cup grasped."""
        return self.outcome in SUCCESSES


def run_batch(
    skill: Skill,
    scenario: Scenario,
    starts: FloatArray,
    *,
    adapt: Adapt | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[Row, ...]:
    """Return the episodes of a scenario, in order. Neither the order nor the workers change them.

    Args:
        skill: The skill that is run.
        scenario: How many episodes, and what is drawn for each (see ``drawn``).
        starts: Starts of the skill's demonstrations, shape (n, d).
        adapt: Changes the skill for each episode that is drawn.
        workers: Processes, or a cluster; one process by default, but never this one.
        progress: Called before the first and after every episode, with episodes done and in all.

    Raises:
        NotFoundError, UsageError: As ``simulate`` raises them for one episode.
    """
    count, finished, successes, began = scenario.episodes, 0, 0, time.perf_counter()

    def done(_: int, row: Row | WorkerDied) -> None:
        nonlocal finished, successes
        finished += 1
        successes += isinstance(row, Row) and row.success
        if progress is not None:
            rate = finished / max(time.perf_counter() - began, 1e-9)
            progress(f"{successes} of {finished} succeeded, {rate:.1f} episodes/s", finished, count)

    def waiting(words: str) -> None:
        if progress is not None:
            progress(words, finished, count)

    waiting("starting")
    task = partial(run_row, skill, scenario, starts, adapt=adapt)
    rows = (workers or Workers()).run(task, range(count), done=done, waiting=waiting, isolated=True)

    def crashed(index: int) -> Row:
        lost = drawn(scenario, index, starts, skill.space)
        return Row(index, lost, "crashed", "its process died", None, None)

    return tuple(row if isinstance(row, Row) else crashed(index) for index, row in enumerate(rows))


def run_row(
    skill: Skill, scenario: Scenario, starts: FloatArray, index: int, adapt: Adapt | None = None
) -> Row:
    """Return one episode of a batch."""
    chosen = drawn(scenario, index, starts, skill.space)
    try:
        episode = simulate(adapt(skill, chosen) if adapt else skill, chosen)
    except RefusedError as refusal:
        return Row(index, chosen, refusal.outcome, str(refusal), None, None)
    except GoalNotReachedError as refusal:
        return Row(index, chosen, "unreachable", str(refusal), None, None)
    return Row(index, chosen, episode.outcome, episode.detail, episode.metrics, _trace(episode))


def _trace(episode: Episode) -> Trace:
    series = episode.series
    moving = series.phases == PHASES.index("approach")
    if isinstance(episode.setup.skill, ChainedSkill):
        moving[:] = True
    path, turns = series.hand[moving], series.hand_turns[moving]
    shown = spread_out(path, PATH_SPACING)
    return Trace(
        arm=episode.setup.arm,
        hand=episode.setup.hand,
        base_yaw=episode.setup.base_yaw,
        plane=episode.setup.placement.plane,
        joints=series.joints[0],
        fingers=series.fingers[0],
        path=path[shown],
        turns=turns[shown] if episode.setup.turns else turns[:0],
        cup=series.cups[0],
        target=episode.target,
        part=int(series.parts[0]),
        avoided=episode.setup.avoided,
    )
