"""The start of a run, and what differs between the episodes of a batch, none of which depends on another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.errors import UsageError
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.model.space import Euclidean, Space
from skillctl.simulation.clutter import bottles
from skillctl.simulation.disturbances import Knock
from skillctl.simulation.scenario import Cup, Sampling, Scenario
from skillctl.simulation.values import Range

CUP_DEPTH = (0.05, 0.18)  # [m] behind the front edge of a board: where cups are drawn by default
CUP_REACH, CUP_CLEARANCE = 0.42, 0.10  # [m] to both sides; [m] to a board's ends
START_SCATTER, START_SHARE = 0.02, 0.1  # [m]; of the shortest demonstration, if that is less
TURN_SCATTER = 0.05  # [rad], about three degrees
POSITIONS = Euclidean.cartesian(3)

Taught: TypeAlias = Sequence[DemonstrationSet | None]  # per leaf of a skill
Stream: TypeAlias = Literal["cup", "start", "body", "seed", "turn", "bottles", "place", "knock"]
STREAMS: tuple[Stream, ...] = get_args(Stream)  # append only


def chosen(
    skill: Skill, taught: Taught, scenario: Scenario, *, demo: int | None, episode: int | None
) -> Scenario:
    """Return the scenario of one run.

    Args:
        skill: The skill that is run.
        taught: The demonstrations of each leaf of the skill.
        scenario: The scenario as it was given.
        demo: Number, from 0 over all leaves, of the demonstration whose start is used; it moves as the target
            does.
        episode: Number, from 0, of the one episode to run of those that the scenario draws.

    Raises:
        UsageError: A start is given twice, or there is no such demonstration or episode.
    """
    if demo is not None:
        scenario = scenario.changed(start=_start_of(demo, skill, taught, scenario))
    if episode is None:
        return _oriented(scenario, _starts(skill, taught), skill.space)
    batch, starts = batch_of(skill, taught, scenario)
    return drawn(batch, episode, starts, skill.space)


def _start_of(demo: int, skill: Skill, taught: Taught, scenario: Scenario) -> tuple[float, ...]:
    if scenario.start is not None:
        raise UsageError("start: given twice, by --start and by --demo.", hint="Leave one of them out.")
    demonstrations = _carried(taught)
    if not 0 <= demo < len(demonstrations):
        raise UsageError(
            f"demonstration {demo} does not exist; the skill carries {len(demonstrations)}, counted from 0.",
            hint="`skillctl inspect` lists them; --start gives a start in numbers.",
        )
    space, start, target = skill.space, demonstrations[demo].positions[0], scenario.target
    if target is not None and target != "cup" and len(target) in space.sizes:
        goal = retargeted(skill, target).attractors[0]
        start = space.carried(start, skill.attractors[0], goal, turn=scenario.turn)
    return tuple(start.tolist())


def _carried(taught: Taught) -> list[Demonstration]:
    return [demonstration for each in taught if each is not None for demonstration in each]


def batch_of(skill: Skill, taught: Taught, scenario: Scenario) -> tuple[Scenario, FloatArray]:
    """Return a scenario whose sampling is given, and the starts that it may draw from, shape (n, d)."""
    starts, d = _starts(skill, taught), skill.space.positions
    reaches = [length(each.positions[-1, :d] - each.positions[0, :d]) for each in _carried(taught)]
    batch = with_defaults(_oriented(scenario, starts, skill.space), starts, min(reaches, default=0.0))
    return batch, starts


def _starts(skill: Skill, taught: Taught) -> FloatArray:
    """Return the starts of all demonstrations that a skill carries, shape (n, d)."""
    return np.array([each.positions[0] for each in _carried(taught)]).reshape(-1, skill.dimension)


def _oriented(scenario: Scenario, starts: FloatArray, space: Space) -> Scenario:
    """Return the scenario; a start that is a position only is turned as the nearest demonstrated one."""
    d, start = space.positions, scenario.start
    if start is None or len(start) != d or not d < space.dimension or not len(starts):
        return scenario
    nearest = starts[np.linalg.norm(starts[:, :d] - start, axis=1).argmin()]
    return scenario.changed(start=(*start, *nearest[d:].tolist()))


def with_defaults(scenario: Scenario, starts: FloatArray, reach: float) -> Scenario:
    """Return the scenario with the default sampling, unless it has its own.

    The cup's place on its board is drawn unless it was given, and so is the start, near the start of a
    demonstration.

    Args:
        scenario: The scenario of the batch.
        starts: Starts of the skill's demonstrations, shape (n, d); n may be 0.
        reach: Smallest distance from the start to the end of a demonstration, [m].
    """
    if scenario.sampling != Sampling():
        return scenario
    changes: dict[str, Any] = {}
    cup, scene = scenario.cup, scenario.scene
    if cup is not None and cup.position is None and scene is not None:
        half = min(CUP_REACH, 0.5 * scene.width - CUP_CLEARANCE)
        changes["cup_x_range"] = tuple(round(scene.x_range[0] + depth, 6) for depth in CUP_DEPTH)
        changes["cup_y_range"] = (-half, half)
    if scenario.start is None and len(starts):
        changes["start_scatter"] = float(f"{min(START_SCATTER, START_SHARE * reach):.1g}")
    return scenario.changed(sampling=Sampling(**changes))


def drawn(scenario: Scenario, episode: int, starts: FloatArray, space: Space = POSITIONS) -> Scenario:
    """Return the scenario of one episode: all is drawn, and nothing is left to draw.

    Every quantity has its own generator, made from (seed, episode, quantity). So an episode does not depend
    on which others are run, and the cups and starts do not depend on whether masses are drawn too. The hand
    of a pose skill is turned at a drawn start as at the nearest demonstrated one, within some degrees.

    Args:
        scenario: The scenario of the batch.
        episode: Number of the episode, from 0.
        starts: Starts of the skill's demonstrations, shape (n, d); ``start_scatter`` needs them.
        space: What these are.

    Raises:
        UsageError: ``start_scatter``, and the skill carries no demonstrations; an episode below 0.
    """
    if episode < 0:
        raise UsageError(f"episode: counted from 0, got {episode}.")
    sampling = scenario.sampling
    generators = {
        stream: np.random.default_rng(np.random.SeedSequence(scenario.seed, spawn_key=(episode, i)))
        for i, stream in enumerate(STREAMS)
    }
    changes: dict[str, object] = {
        "seed": int(generators["seed"].integers(2**63)),
        "episodes": 1,
        "sampling": Sampling(),
    }
    if scenario.cup is not None and scenario.scene is not None:
        cup = changes["cup"] = _cup(scenario.cup, sampling, generators["cup"], generators["body"])
        if sampling.bottles is not None:
            beside = bottles(sampling.bottles, cup, scenario.scene, generators["bottles"])
            changes["obstacles"] = (*scenario.obstacles, *beside)
    if scenario.place is not None:
        x, y = scenario.place.place
        place = generators["place"]
        position = _between(sampling.place_x_range, x, place), _between(sampling.place_y_range, y, place)
        changes["place"] = scenario.place.model_copy(update={"position": position})
    if sampling.knock_time_range is not None:
        time = _between(sampling.knock_time_range, 0.0, generators["knock"])
        changes["disturbances"] = tuple(
            event.model_copy(update={"time": time}) if isinstance(event, Knock) else event
            for event in scenario.disturbances
        )
    box = (sampling.start_x_range, sampling.start_y_range, sampling.start_z_range)
    if sampling.start_scatter is not None:
        positions = starts[:, : space.positions]
        changes["start"] = _near(positions, sampling.start_scatter, generators["start"])
    elif box[0] is not None:
        changes["start"] = tuple(_between(ends, 0.0, generators["start"]) for ends in box)
    turned = _oriented(scenario.changed(**changes), starts, space)
    if space.positions == space.dimension or "start" not in changes or not len(starts):
        return turned
    scatter = TURN_SCATTER * generators["turn"].standard_normal(space.dimension)
    scatter[: space.positions] = 0.0
    return turned.changed(start=tuple(space.displace(np.array(turned.start), scatter).tolist()))


def _cup(cup: Cup, sampling: Sampling, place: np.random.Generator, body: np.random.Generator) -> Cup:
    x, y = cup.place
    position = _between(sampling.cup_x_range, x, place), _between(sampling.cup_y_range, y, place)
    boards = sampling.boards or (cup.board,)
    changes = {
        "position": position,
        "board": boards[int(place.random() * len(boards))],
        "mass": _between(sampling.mass_range, cup.mass, body),
        "friction": _between(sampling.friction_range, cup.friction, body),
        "radius": _between(sampling.radius_range, cup.radius, body),
    }
    return cup.model_copy(update=changes)  # what is drawn lies in ranges that were checked


def _between(ends: Range | None, otherwise: float, generator: np.random.Generator) -> float:
    """Draw uniformly. A number is used up even without a range, so that later draws stay the same."""
    share = generator.random()
    return otherwise if ends is None else ends[0] + share * (ends[1] - ends[0])


def _near(starts: FloatArray, scatter: float, generator: np.random.Generator) -> tuple[float, ...]:
    if not len(starts):
        raise UsageError(
            "start_scatter: the skill carries no demonstrations whose starts could be scattered.",
            hint="Give a box instead: start_x_range, start_y_range and start_z_range.",
        )
    start = starts[generator.integers(len(starts))]
    return tuple((start + scatter * generator.standard_normal(len(start))).tolist())
