"""Tasks: what a motion is to do, as data; read from a TOML file, or made in Python.

    scene = "shelf.toml"         # a scenario: its furniture and obstacles are kept out of
    hand-radius = 0.05

    [target]
    position = [0.63, 0.28, 0.76]

    [start]
    low = [0.385, -0.2, 0.5]
    high = [0.44, 0.2, 0.58]

    [[keep-out]]
    name = "bottle"
    kind = "cylinder"
    centre = [0.62, 0.14, 0.8]
    radius = 0.035
    height = 0.2

    [approach]
    direction = [1, 0, 0]
    within-deg = 30
    from = 0.1

Lengths are in metres, times in seconds, angles in radians unless the key says ``deg``. Places are in
the skill's frame.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from skillctl.adapt.clauses import (
    TURN,
    Approach,
    Clause,
    Demonstrations,
    Like,
    NotNegative,
    Orientation,
    PeriodLimit,
    Positive,
    SpeedLimit,
    StayIn,
    Table,
    Target,
    TimeLimit,
    Vector,
    Via,
)
from skillctl.adapt.keep_out import BODIES, AnyKeepOut, box_between
from skillctl.arrays import FloatArray
from skillctl.errors import InputDataError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.rotations import quaternions
from skillctl.simulation.scenario import CylinderObstacle, MeshObstacle, Scenario
from skillctl.simulation.scenario_file import read_scenario
from skillctl.simulation.scene import boxes, cup_middle
from skillctl.toml_files import complaint, parse_toml, read_toml

HINT = "`skillctl adapt --print-task DEMO` writes one."
POSE = 7  # numbers of a pose, x,y,z,qx,qy,qz,qw: clauses about places have three
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
MOST_CORNERS = 8  # of a start box with more, only the lowest and the highest are tried


class Start(Table):
    """Where motions begin: anywhere in a box, or at some points.

    Attributes:
        low, high: Corners of the box, in the skill's frame.
        points: The only starts there are, instead of a box.
    """

    low: Vector | None = None
    high: Vector | None = None
    points: Annotated[tuple[Vector, ...], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _is_one_of_both(self) -> Start:
        if (self.low is None) != (self.high is None) or (self.low is None) == (self.points is None):
            raise ValueError("give low and high, or points.")
        if self.low is not None and self.high is not None:
            if len(self.low) != len(self.high) or any(a > b for a, b in zip(self.low, self.high)):  # noqa: B905
                raise ValueError("low must have as many numbers as high, and none above it.")
        elif len({len(point) for point in self.points or ()}) > 1:
            raise ValueError("points: all must have equally many numbers.")
        return self

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates of the starts, (d,) each."""
        ends = np.array(self.points or (self.low, self.high))
        return ends.min(axis=0), ends.max(axis=0)

    def corners(self) -> FloatArray:
        """Return the corners of the box, of many only the lowest and the highest; or all points. (n, d)."""
        if self.points is not None:
            return np.array(self.points)
        low, high = self.box
        if 2 ** len(low) > MOST_CORNERS:
            return np.stack([low, high])
        return np.unique(np.array(list(product(*zip(low, high, strict=True)))), axis=0)

    def spread(self, count: int) -> FloatArray:
        """Return the corners, and so many more evenly spread over the box as make ``count``. Shape (n, d).

        References:
            J. H. Halton, Numerische Mathematik 2 (1960) 84–90: the sequence behind the even spread.
        """
        low, high = self.box
        corners = self.corners()
        if self.points is not None or (low == high).all():
            return corners
        inner = [[_halton(i, p) for p in PRIMES[: len(low)]] for i in range(1, count - len(corners) + 1)]
        return np.concatenate([corners, low + np.reshape(inner, (-1, len(low))) * (high - low)])

    def drawn(self, count: int, seed: int) -> FloatArray:
        """Return ``count`` starts drawn evenly from the box by a seed, or all there are. Shape (n, d)."""
        low, high = self.box
        if self.points is not None or (low == high).all():
            return self.corners()
        return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


class Limits(Table):
    """Numbers that no motion exceeds.

    Attributes:
        speed: Of the hand, [m/s].
        time: Until it has arrived for good, [s].
        period: At which a controller gives commands, [s].
    """

    speed: Positive | None = None
    time: Positive | None = None
    period: Positive | None = None

    def clauses(self) -> Iterator[Clause]:
        """Yield a clause for each limit that is given."""
        kinds = {"speed": SpeedLimit, "time": TimeLimit, "period": PeriodLimit}
        for name, kind in kinds.items():
            if (most := getattr(self, name)) is not None:
                yield kind(name=name, most=most)


class Task(Table):
    """What a motion is to do. Every clause has to hold from every start.

    Attributes:
        scene: Scenario file, relative to the task's file, whose furniture and obstacles are kept out of.
        hand_radius: The hand is a ball of this radius around its position, [m]; bodies are larger by it.
        target, start: Where motions end and begin.
        via, keep_out, stay_in, approach, limits, demonstrations, like: The other clauses.
    """

    scene: str | None = None
    hand_radius: NotNegative = 0.0
    target: Target
    start: Start
    via: tuple[Via, ...] = ()
    keep_out: tuple[AnyKeepOut, ...] = ()
    stay_in: tuple[StayIn, ...] = ()
    approach: Approach | None = None
    limits: Limits = Limits()
    demonstrations: tuple[Demonstrations, ...] = ()
    like: tuple[Like, ...] = ()

    def __init__(self, **values: Any) -> None:
        """Check all values.

        Raises:
            UsageError: A value is not valid; the message names it and what was expected.
        """
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise UsageError(complaint(error.errors(include_url=False), KEYS)) from error

    @model_validator(mode="after")
    def _fits_together(self) -> Task:
        d = len(self.target.position)
        sizes = {d, 3} if d == POSE else {d}
        for name, clause in self.clauses.items():
            for key in ("point", "low", "direction", "centre", "size", "radii"):
                numbers = getattr(clause, key, None)
                if numbers is not None and len(numbers) not in sizes:
                    raise ValueError(f"{name}.{key}: expected {min(sizes)} numbers, got {len(numbers)}.")
        return self

    @property
    def clauses(self) -> dict[str, Clause]:
        """All clauses by their names; a clause without one is called by its key, and counted if need be."""
        entries: list[tuple[str, Clause]] = [("target", self.target)]
        turn = self.target.tolerance_deg or (TURN if len(self.target.position) == POSE else None)
        if turn is not None:
            entries.append(("target.orientation", Orientation(name="target.orientation", most=turn)))
        for key in ("via", "keep_out", "stay_in", "demonstrations", "like"):
            entries += [(key.replace("_", "-"), clause) for clause in getattr(self, key)]
        entries += [("approach", self.approach)] if self.approach else []
        entries += [(f"limits.{clause.name}", clause) for clause in self.limits.clauses()]
        named: dict[str, Clause] = {}
        for key, clause in entries:
            name = key if key.startswith("limits.") else clause.name or key
            number, first = 2, name
            while name in named:
                name, number = f"{first} {number}", number + 1
            named[name] = clause
        return named

    @property
    def way(self) -> float:
        """Distance from the middle of the starts to the target, [m]."""
        low, high = self.start.box
        k = min(len(low), len(self.target.position), 3)
        return float(np.linalg.norm(0.5 * (low + high)[:k] - np.array(self.target.position)[:k]))

    @property
    def digest(self) -> str:
        """Digest of what it says, remarks aside."""
        said = self.model_dump_json(by_alias=True, exclude_defaults=True)
        return f"sha256:{hashlib.sha256(said.encode()).hexdigest()}"


def read_task(path: Path) -> Task:
    """Return the task in a TOML file, with the bodies of its scene among its keep-out clauses.

    Raises:
        NotFoundError: There is no such file, or no such scene.
        InputDataError: It is not TOML, or a key is unknown, missing or has a bad value; names file and key.
    """
    document = read_toml(path, "task", HINT)
    try:
        task = Task(**document)
        return task if task.scene is None else with_scene(task, read_scenario(path.parent / task.scene))
    except UsageError as error:
        raise InputDataError(f"{path}: {error}", hint=error.hint or HINT) from None


def with_scene(task: Task, scenario: Scenario) -> Task:
    """Return the task with the bodies of a scenario, named as there, instead of the name of its file.

    Raises:
        UsageError: The scenario has an obstacle that is a mesh.
    """
    values = {name: getattr(task, name) for name in type(task).model_fields}
    return Task(**{**values, "scene": None, "keep_out": (*task.keep_out, *scene_bodies(scenario))})


def recorded_task(lines: Sequence[str]) -> Task:
    """Return the task that an adapted skill keeps, without what compares motions with other files."""
    task = Task(**parse_toml("\n".join(lines).encode()))
    return task.model_copy(update={"demonstrations": (), "like": ()})


def scene_bodies(scenario: Scenario) -> list[dict[str, Any]]:
    """Return the entries of keep-out clauses for the furniture and the obstacles of a scenario.

    Raises:
        UsageError: An obstacle is a mesh.
    """
    entries = [{"name": box.name, **box_between(box.lower, box.upper)} for box in boxes(scenario.scene)]
    for obstacle in scenario.obstacles:
        if isinstance(obstacle, MeshObstacle):
            raise UsageError(
                f"obstacles: {obstacle.name} is a mesh, whose distance is not known.",
                hint="Name a box around it as a keep-out of the task.",
            )
        form = (
            {"radius": obstacle.radius, "height": obstacle.height}
            if isinstance(obstacle, CylinderObstacle)
            else {"size": obstacle.size}
        )
        turn = (0.0, 0.0, obstacle.yaw) if obstacle.yaw else ()
        entries.append(
            {"name": obstacle.name, "kind": obstacle.kind, "centre": obstacle.position, "turn": turn, **form}
        )
    return entries


def task_of_demonstrations(demonstrations: DemonstrationSet, names: tuple[str, ...]) -> Task:
    """Return a task that demonstrations show: start box, target, and to be near to them.

    Args:
        demonstrations: Of the task.
        names: Of their files.
    """
    starts = np.stack([motion.positions[0] for motion in demonstrations])
    ends = np.stack([motion.positions[-1] for motion in demonstrations])
    target, way = ends.mean(axis=0), float(demonstrations.space.apart(starts, ends)[0].mean())
    k = demonstrations.space.positions
    if k < len(target):  # the last pose: a mean of orientations is none
        target = np.concatenate([target[:k], quaternions(ends[-1, k:])])
    return Task(
        target={"position": _rounded(target)},
        start={"low": _rounded(starts.min(axis=0)), "high": _rounded(starts.max(axis=0))},
        demonstrations=[{"files": names, "tolerance": float(f"{0.1 * way:.2g}")}],
    )


def task_of_scenario(scenario: Scenario) -> Task:
    """Return the task of a scenario: its target, where its episodes start, and the bodies of its scene.

    Raises:
        UsageError: It does not say where the target is, or has a mesh.
    """
    if scenario.cup is not None:
        target = cup_middle(scenario)
    elif scenario.target is not None:
        target = np.array(scenario.target)
    else:
        raise UsageError("print-task: the scenario has neither a cup nor a target.", hint="Add one of them.")
    drawn, low, high = scenario.sampling, np.zeros(3), np.zeros(3)
    ranges = (drawn.start_x_range, drawn.start_y_range, drawn.start_z_range)
    if all(ranges):
        low, high = np.array(ranges).T
    elif scenario.start is not None:
        low = high = np.array(scenario.start)
    else:
        raise UsageError("print-task: the scenario does not say where motions start.", hint="Add a start.")
    return Task(
        target={"position": _rounded(target)},
        start={"low": _rounded(low), "high": _rounded(high)},
        keep_out=scene_bodies(scenario),
    )


def to_toml(task: Task) -> str:
    """Return a task as TOML; reading it gives an equal task."""
    values = task.model_dump(by_alias=True, exclude_defaults=True)
    plain = {key: value for key, value in values.items() if not isinstance(value, dict | tuple)}
    parts = [_lines(plain)] if plain else []
    for key, value in values.items():
        if isinstance(value, dict):
            parts.append(f"[{key}]\n{_lines(value)}")
        elif isinstance(value, tuple):
            parts += [f"[[{key}]]\n{_lines(entry)}" for entry in value]
    return "\n".join(parts)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in table.items())


def _rounded(numbers: FloatArray) -> list[float]:
    return [round(float(number), 4) for number in numbers]


def _halton(index: int, base: int) -> float:
    """Return the digits of ``index`` in a base, mirrored at the point."""
    value, share = 0.0, 1.0
    while index:
        index, digit = divmod(index, base)
        share /= base
        value += share * digit
    return value


PARTS: tuple[type[Table], ...] = (
    Task,
    Start,
    Limits,
    Target,
    Via,
    StayIn,
    Approach,
    Demonstrations,
    Like,
    *BODIES,
)
KEYS = frozenset(field.alias or name for part in PARTS for name, field in part.model_fields.items())
