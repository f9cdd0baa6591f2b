"""Scenarios: arm, placement, scene, cup, target, limits, disturbances and noise of a simulation, as data.

A scenario is one frozen value. It comes from a TOML file, from the command line or from Python, and the same
rules check it in all three cases. Its TOML form has the same names:

    arm = "panda"
    start = [0.40, 0.0, 0.55]
    target = "cup"               # or three numbers; left out: the skill's own attractor; of chains see bind
    noise = 0.003

    [scene]
    kind = "shelf"               # or "table"; left out: no scene

    [cup]
    position = [0.62, 0.10]
    board = "top"

    [[disturbances]]
    kind = "move-target"
    time = 0.8
    offset = [0.0, 0.08, 0.0]

A key that is left out has the default given here. Lengths are in metres, times in seconds, angles in radians.
No time is longer than ten minutes, and no other number larger than a million. Positions are in the workspace
frame, whose origin is the arm's base, but ``start`` and ``target`` are in the skill's own coordinates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, ValidationError, model_validator

from skillctl.errors import UsageError
from skillctl.simulation.arms import ARMS
from skillctl.simulation.disturbances import Displace, Disturbance, Knock, MoveTarget, Push
from skillctl.simulation.options import Board, Control, HandPolicy, Name, Plane
from skillctl.simulation.taking import DEFAULT_PLACE, Destination, Grasp
from skillctl.simulation.values import (
    Count,
    Duration,
    Flag,
    NotNegative,
    Number,
    Part,
    Place,
    Point,
    Positive,
    PositiveRange,
    Range,
    Seed,
    Vector,
)
from skillctl.toml_files import complaint


class Shelf(Part):
    """Two boards one above the other, and a panel behind them. The arm must not touch any of them.

    Attributes:
        boards: Heights of the upper sides of the lower and the upper board, [m].
        x_range: Front and rear edge of the boards, [m].
        width: Width of the boards, symmetric about y = 0, [m].
        thickness: Thickness of boards, panel and walls, [m].
        walls: Whether there are walls at the left and right ends, up to the top of the panel.
    """

    kind: Literal["shelf"] = "shelf"
    boards: tuple[Positive, Positive] = (0.42, 0.70)
    x_range: PositiveRange = (0.50, 0.80)
    width: Positive = 1.2
    thickness: Positive = 0.02
    walls: Flag = False


class Table(Part):
    """One board on four legs. The arm must not touch it.

    Attributes:
        height: Height of its upper side, [m].
        x_range: Front and rear edge, [m].
        width: Width, symmetric about y = 0, [m].
        thickness: Thickness of the board, [m].
    """

    kind: Literal["table"] = "table"
    height: Positive = 0.42
    x_range: PositiveRange = (0.45, 1.05)
    width: Positive = 1.2
    thickness: Positive = 0.03


Scene: TypeAlias = Annotated[Shelf | Table, Field(discriminator="kind")]


class BoxObstacle(Part):
    """A box that does not move. The arm must not touch it.

    Attributes:
        name: What reports call it.
        position: Its middle, [m].
        yaw: Turn about the vertical, [rad].
        size: Its edges along x, y and z before the turn, [m].
    """

    kind: Literal["box"] = "box"
    name: str = "box"
    position: Point
    yaw: Number = 0.0
    size: tuple[Positive, Positive, Positive]


class CylinderObstacle(Part):
    """An upright cylinder; see ``BoxObstacle``. With a ``mass`` [kg] it stands loose, as a bottle does."""

    kind: Literal["cylinder"] = "cylinder"
    name: str = "cylinder"
    position: Point
    yaw: Number = 0.0
    radius: Positive
    height: Positive
    mass: Positive | None = None


class MeshObstacle(Part):
    """A mesh, whose origin is at ``position``; see ``BoxObstacle``.

    Attributes:
        file: A binary STL, OBJ or DAE file; a relative name is relative to the scenario's file.
        scale: Metres per unit of the mesh.
    """

    kind: Literal["mesh"] = "mesh"
    name: str = "mesh"
    position: Point
    yaw: Number = 0.0
    file: str
    scale: Positive = 1.0


Obstacle: TypeAlias = Annotated[BoxObstacle | CylinderObstacle | MeshObstacle, Field(discriminator="kind")]


class Cup(Part):
    """A cup, drawn as one, and for physics a solid upright cylinder.

    Attributes:
        position: Place of its axis, (x, y), [m]. None: (0.62, 0); in a batch it is drawn.
        board: The board of a shelf on which it stands; a table has only one.
        radius, height: [m].
        mass: [kg], evenly distributed.
        friction: Coulomb's coefficient, to be multiplied with that of the other body (fingers: 1).
    """

    position: Place | None = None
    board: Board = "top"
    radius: Positive = 0.032
    height: Positive = 0.12
    mass: Positive = 0.1
    friction: Positive = 0.5

    @property
    def place(self) -> Place:
        """Place of its axis, (x, y), [m]."""
        return DEFAULT_PLACE if self.position is None else self.position


class Sampling(Part):
    """Ranges from which the episodes of a batch are drawn uniformly. None: the scenario's own value.

    If all are None, the cup's place on its board is drawn unless it was given, and so is the start, near that
    of a demonstration.

    Attributes:
        cup_x_range, cup_y_range: Ranges of the cup's place, [m].
        boards: Boards of a shelf, with equal probability.
        place_x_range, place_y_range: Ranges of the place where a chain sets the cup down, [m].
        knock_time_range: Range of the time of a knock, which all of them get, [s].
        start_x_range, start_y_range, start_z_range: Ranges of the hand's start, [m]; all three or none.
        start_scatter: Instead of these: standard deviation, [m], of a normal distribution around the start
            of one of the skill's demonstrations, which is drawn, too.
        mass_range, friction_range, radius_range: Ranges of the cup's properties.
        bottles: Number of bottles that stand beside the cup, on its board (see ``clutter``).
    """

    cup_x_range: Range | None = None
    cup_y_range: Range | None = None
    boards: Annotated[tuple[Board, ...], Field(min_length=1)] | None = None
    start_x_range: Range | None = None
    start_y_range: Range | None = None
    start_z_range: Range | None = None
    start_scatter: NotNegative | None = None
    mass_range: PositiveRange | None = None
    friction_range: PositiveRange | None = None
    radius_range: PositiveRange | None = None
    bottles: Count | None = None
    place_x_range: Range | None = None
    place_y_range: Range | None = None
    knock_time_range: Range | None = None

    @model_validator(mode="after")
    def _starts_are_whole(self) -> Sampling:
        starts = (self.start_x_range, self.start_y_range, self.start_z_range)
        if any(starts) and not all(starts):
            raise ValueError("start_x_range, start_y_range and start_z_range: give all three, or none.")
        if all(starts) and self.start_scatter is not None:
            raise ValueError("start_scatter: it takes the place of the ranges of the start.")
        return self


class Scenario(Part):
    """Everything about a simulated run but the skill. None: chosen automatically (see ``prepare``).

    Attributes:
        arm: A name in ``ARMS``, or the path of a URDF file.
        tip, home, hold: The hand of an arm by path, a link; its ready posture, [rad]; joints that do not
            move, and where they stay, [rad] or [m] (see ``find_arm``).
        package: Folders whose meshes an arm by path may name besides those of its own package. A scenario
            file cannot say so.
        start: Start of the motion, in the skill's own coordinates. None: the arm's ready posture; in a scene
            10 cm before its front edge, 13 cm above the lowest board.
        target: New place of the skill's attractor, in its own coordinates, or ``cup``: the middle of the cup
            as it is perceived. None: not moved.
        bind: Targets of stages of a chain, counted from 1: ``cup``; ``place``; ``home``, which is the default
            start; or coordinates of the skill. A stage that is not named keeps its own.
        turn: Whether the whole motion of a pose skill turns with its target.
        plane: Workspace plane of a 2-D skill. None: by its coordinate names.
        scale: Workspace metres per metre of the skill. None: 1; a 2-D skill much smaller or larger than
            the workspace is scaled to 0.3 m.
        origin: Workspace position of the skill's zero, [m]. None: 0 for a 3-D skill; a 2-D skill is
            centred in front of the arm.
        hand: Orientation of the hand (see ``Kinematics``). None: the first of horizontal, down and free
            (in the xy plane down, horizontal, free) with which the arm can follow the whole plan within 1 mm.
        base_yaw: Turn of the arm's base about the vertical, [rad]. None: 0 in a scene, else the multiple of
            a quarter turn that faces the target.
        control: ``position``: motors that hold against pushes; ``torque``: a compliant hand.
        posture: What a compliant arm draws its joints to, as far as that does not move the hand: the ready
            posture, or (``follow``) that of a stiff arm where the hand is, which keeps off joint limits.
        max_speed, max_acceleration: Limits of the hand, [m/s] and [m/s²].
        max_turn, max_turn_acceleration: Those of turning, of a pose skill, [rad/s] and [rad/s²].
        tolerance: Distance to the true target that counts as reached, [m]; of joints, [rad].
        turn_tolerance: Angle to it that does, of a pose skill, [rad].
        settle_time: Time for which the hand must stay within the tolerance, [s].
        max_duration: Longest simulated time, [s]. None: by the duration of the plan.
        noise: Standard deviation of the measured position of the hand, per coordinate, [m].
        target_error: Standard deviation of the perceived target, per horizontal coordinate, [m]; it is drawn
            at the start, and again when the target moves. The skill goes to the perceived target; success is
            judged by the true one.
        seed: Seed of noise, target error and sampling.
        scene: The furniture in front of the arm. None: nothing.
        obstacles: Other things that the arm must not touch, with or without furniture.
        cup: The cup, which the hand grasps and lifts at its target. None: none, unless the target is the cup.
        place: Where a chain sets it down. None: nowhere, unless a stage is bound to it.
        grasp: How the hand grasps and lifts.
        avoid: Whether the hand keeps out of scene and obstacles, as far as the target allows (see ``avoid``).
            None: if the skill is in three dimensions at its own scale.
        adapt: Whether the use cases choose a merged skill's weights for each episode (see ``adapt``).
        disturbances: Pushes and jumps, with their times.
        episodes: Number of episodes of a batch.
        sampling: Ranges from which these are drawn.
    """

    arm: Annotated[str, Field(strict=True)] = "panda"
    tip: Annotated[str, Field(strict=True)] | None = None
    home: Vector | None = None
    hold: dict[str, Number] = Field(default_factory=dict)
    package: tuple[Annotated[str, Field(strict=True)], ...] = Field(default=(), exclude=True)
    start: Vector | None = None
    target: Literal["cup"] | Vector | None = None
    bind: dict[str, Name | Vector] = Field(default_factory=dict)
    turn: Flag = False
    plane: Plane | None = None
    scale: Positive | None = None
    origin: Point | None = None
    hand: HandPolicy | None = None
    base_yaw: Number | None = None
    control: Control = "position"
    posture: Literal["ready", "follow"] = "ready"
    max_speed: Positive = 0.3
    max_acceleration: Positive = 1.5
    max_turn: Positive = 1.5
    max_turn_acceleration: Positive = 7.5
    tolerance: Positive = 2e-3
    turn_tolerance: Positive = 0.0349  # two degrees
    settle_time: Duration = 0.5
    max_duration: Duration | None = None
    noise: NotNegative = 0.0
    target_error: NotNegative = 0.0
    seed: Seed = 0
    episodes: Count = 1
    scene: Scene | None = None
    obstacles: tuple[Obstacle, ...] = ()
    cup: Cup | None = None
    place: Destination | None = None
    grasp: Grasp = Grasp()
    avoid: Flag | None = None
    adapt: Flag = False
    disturbances: tuple[Disturbance, ...] = ()
    sampling: Sampling = Sampling()

    if not TYPE_CHECKING:  # a type checker takes the keywords from the fields

        def __init__(self, **values: Any) -> None:
            """Check all values.

            Raises:
                UsageError: A value is not valid; the message names it and what was expected.
            """
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise UsageError(complaint(error.errors(include_url=False), KEYS)) from error

    @model_validator(mode="before")
    @classmethod
    def _target_brings_the_cup(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        bound = [values.get("target"), *dict(values.get("bind") or {}).values()]
        missing = [name for name in ("cup", "place") if name in bound and values.get(name) is None]
        defaults = {"cup": Cup(), "place": Destination()}
        return {**values, **{name: defaults[name] for name in missing}}

    @model_validator(mode="after")
    def _fits_together(self) -> Scenario:
        if self.arm not in ARMS and "." not in self.arm and "/" not in self.arm:
            raise ValueError(f"arm: one of {', '.join(ARMS)}, or a file.urdf; not {self.arm!r}.")
        if self.cup is not None and self.scene is None:
            raise ValueError("cup: it needs something to stand on, as in --scene shelf or --scene table.")
        if self.place is not None and self.cup is None:
            raise ValueError("place: there is no cup to set down there; bind a stage to it, as in 1=cup.")
        for name, standing in (("cup", self.cup), ("place", self.place)):
            if standing is None or self.scene is None:
                continue
            (front, back), half, (x, y) = self.scene.x_range, 0.5 * self.scene.width, standing.place
            if not (front < x < back and -half < y < half):
                raise ValueError(
                    f"{name}.position: ({x:g}, {y:g}) is not on a board; those lie at x from {front:g} to "
                    f"{back:g} and y from {-half:g} to {half:g}."
                )
        return self

    @property
    def furnished(self) -> bool:
        """Whether there is something that the arm must not touch."""
        return self.scene is not None or bool(self.obstacles)

    @property
    def grasping(self) -> bool:
        """Whether the hand grasps and lifts a cup at its target."""
        return self.cup is not None

    def stages_at(self, name: Name) -> tuple[int, ...]:
        """Return the stages of a chain, from 0, that are bound to a thing of this name."""
        return tuple(sorted(int(stage) - 1 for stage, bound in self.bind.items() if bound == name))

    def changed(self, **values: Any) -> Scenario:
        """Return this scenario with some values changed, and checked.

        Raises:
            UsageError: A value is not valid.
        """
        return Scenario(**{**{name: getattr(self, name) for name in type(self).model_fields}, **values})


PARTS = (
    Scenario,
    Shelf,
    Table,
    BoxObstacle,
    CylinderObstacle,
    MeshObstacle,
    Cup,
    Destination,
    Grasp,
    Push,
    MoveTarget,
    Displace,
    Knock,
    Sampling,
)
KEYS = frozenset(name for part in PARTS for name in part.model_fields)
