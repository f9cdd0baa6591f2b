"""What to simulate, as data: arm, placement, scene, cup, target, limits, disturbances, noise.

A scenario is one frozen value. It is read from a TOML file, written on the command line, or made in
Python, and checked in all three cases by the same rules. Its TOML form has the same names:

    arm = "panda"
    start = [0.40, 0.0, 0.55]
    target = "cup"               # or three numbers; left out: the skill's own attractor
    noise = 0.003

    [scene]
    kind = "shelf"               # or "table"; left out: nothing but the arm

    [cup]
    position = [0.62, 0.10]
    board = "top"

    [[disturbances]]
    kind = "move-target"
    time = 0.8
    offset = [0.0, 0.08, 0.0]

What is left out has the default given here. All lengths are in metres, times in seconds, angles in
radians; positions are in the workspace frame, in which the arm's base stands at the origin, except
``start`` and ``target``, which are in the skill's own coordinates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from skillctl.errors import UsageError
from skillctl.simulation.arms import ARMS
from skillctl.simulation.options import Board, Control, HandPolicy, Plane
from skillctl.toml_files import complaint

DEFAULT_PLACE = (0.62, 0.0)  # [m], of a cup

# Strict: 0.3 and 1 are numbers, "0.3" and true are not.
Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Count: TypeAlias = Annotated[int, Field(strict=True, ge=1)]
Seed: TypeAlias = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Vector: TypeAlias = Annotated[tuple[Number, ...], Field(min_length=1)]
Point: TypeAlias = tuple[Number, Number, Number]
Place: TypeAlias = tuple[Number, Number]
Range: TypeAlias = tuple[Number, Number]
PositiveRange: TypeAlias = tuple[Positive, Positive]


class Part(BaseModel):
    """Frozen; nothing unknown is accepted, so that a misspelt key is told and not ignored."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="after")
    def _ranges_ascend(self) -> Part:
        for name in type(self).model_fields:
            if name.endswith("_range") and (ends := getattr(self, name)) is not None and ends[0] > ends[1]:
                raise ValueError(f"{name}: the first number must not be above the second.")
        return self


class Shelf(Part):
    """Two boards one above the other, and a panel behind them. The arm may touch none of it.

    Attributes:
        boards: Heights of the upper sides of the lower and the upper board, [m].
        x_range: Front and rear edge of the boards, [m].
        width: Of the boards, symmetric about y = 0, [m].
        thickness: Of boards, panel and walls, [m].
        walls: Whether there are walls at the left and right ends, up to the top of the panel.
    """

    kind: Literal["shelf"] = "shelf"
    boards: tuple[Positive, Positive] = (0.42, 0.70)
    x_range: PositiveRange = (0.50, 0.80)
    width: Positive = 1.2
    thickness: Positive = 0.02
    walls: Flag = False


class Table(Part):
    """One board on four legs. The arm may not touch it.

    Attributes:
        height: Of its upper side, [m].
        x_range: Front and rear edge, [m].
        width: Symmetric about y = 0, [m].
        thickness: Of the board, [m].
    """

    kind: Literal["table"] = "table"
    height: Positive = 0.42
    x_range: PositiveRange = (0.45, 1.05)
    width: Positive = 1.2
    thickness: Positive = 0.03


Scene: TypeAlias = Annotated[Shelf | Table, Field(discriminator="kind")]


class Cup(Part):
    """A cup: seen as one, and for physics a solid upright cylinder.

    Attributes:
        position: Where its axis stands, (x, y), [m]. None: (0.62, 0); in a batch it is drawn.
        board: On which board of a shelf; a table has only one.
        radius, height: [m].
        mass: [kg], evenly distributed.
        friction: Coulomb's coefficient; what acts is its product with that of the other body (fingers: 1).
    """

    position: Place | None = None
    board: Board = "top"
    radius: Positive = 0.032
    height: Positive = 0.12
    mass: Positive = 0.1
    friction: Positive = 0.5

    @property
    def place(self) -> Place:
        """Where its axis stands, (x, y), [m]."""
        return DEFAULT_PLACE if self.position is None else self.position


class Grasp(Part):
    """What the hand does when it has reached the cup.

    Attributes:
        distance: From the grasp point at which the fingers begin to close, [m].
        force: Of each finger, [N].
        speed: Of each finger, [m/s].
        close_time: From then to the lift, [s].
        lift: How far the hand goes up, [m], with minimum jerk; less if the arm does not reach so far, but not
            less than ``rise``.
        lift_time, hold_time: Duration of the lift, and of standing still after it, [s].
        rise: How far the cup has to be up all through the hold, [m].
    """

    distance: Positive = 0.006
    force: Positive = 20.0
    speed: Positive = 0.1
    close_time: Positive = 0.8
    lift: Positive = 0.10
    lift_time: Positive = 1.2
    hold_time: Positive = 1.0
    rise: Positive = 0.05

    @model_validator(mode="after")
    def _lifts_enough(self) -> Grasp:
        if self.lift < self.rise:
            raise ValueError("lift: must not be less than rise.")
        return self


class Push(Part):
    """A force on the hand. Position motors hold against some 100 N; under torque control the hand yields."""

    kind: Literal["push"] = "push"
    time: NotNegative
    duration: Positive
    force: Point


class MoveTarget(Part):
    """The target, and the cup if there is one, jumps by ``offset`` [m]; the skill's target goes along."""

    kind: Literal["move-target"] = "move-target"
    time: NotNegative
    offset: Point


class Displace(Part):
    """The hand jumps by ``offset`` [m], as if somebody had taken it there."""

    kind: Literal["displace"] = "displace"
    time: NotNegative
    offset: Point


Disturbance: TypeAlias = Annotated[Push | MoveTarget | Displace, Field(discriminator="kind")]


class Sampling(Part):
    """What the episodes of a batch are drawn from, uniformly. None: as the scenario itself says.

    If nothing at all is said, a cup's place on its board is drawn (unless it was given) and the start is
    one of the demonstrations', scattered (unless one was given).

    Attributes:
        cup_x_range, cup_y_range: Of the cup's place, [m].
        boards: Boards of a shelf, each as likely as the next.
        start_x_range, start_y_range, start_z_range: Of the hand's start, [m]; all three or none.
        start_scatter: Instead of a range: starts are those of the demonstrations that the skill carries,
            one of them at random, and normally distributed around it with this standard deviation, [m].
        mass_range, friction_range, radius_range: Of the cup.
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

    @model_validator(mode="after")
    def _starts_are_whole(self) -> Sampling:
        starts = (self.start_x_range, self.start_y_range, self.start_z_range)
        if any(starts) and not all(starts):
            raise ValueError("start_x_range, start_y_range and start_z_range: give all three, or none.")
        if all(starts) and self.start_scatter is not None:
            raise ValueError("start_scatter: it takes the place of the ranges of the start.")
        return self


class Scenario(Part):
    """How a skill is put on an arm and run. None means: chosen automatically (see ``prepare``).

    Attributes:
        arm: A name in ``ARMS``, or the path of a URDF file.
        tip, home: Of an arm by path, see ``find_arm``: the link that is its hand; its ready posture, [rad].
        start: Where the motion begins, in the skill's own coordinates; None: the arm's ready posture, and
            in a scene 10 cm before its front edge, 13 cm above the lowest board.
        target: Where the skill's attractor is moved to: a point in the skill's own coordinates, or
            ``cup``: the middle of the cup as it is perceived. None: not moved.
        plane: Workspace plane of a 2-D skill; None: the one its coordinate names say.
        scale: Workspace metres per metre of the skill. None: 1; a 2-D skill much smaller or larger than
            the workspace is brought to 0.3 m.
        origin: Workspace position of the skill's zero, [m]. None: 0 for a 3-D skill; a 2-D skill is
            centred in front of the arm.
        hand: Orientation of the hand (see ``Kinematics``). None: the first of horizontal, down and free
            (in the xy plane down, horizontal, free) with which the arm can follow the whole plan within 1 mm.
        base_yaw: How far the arm's base is turned about the vertical, [rad]. None: 0 in a scene, else to
            the multiple of a quarter turn that faces the target.
        control: ``position``: motors that hold against pushes; ``torque``: a compliant hand.
        max_speed, max_acceleration: Of the hand, [m/s] and [m/s²].
        tolerance: Distance to the target that counts as reached, [m].
        settle_time: How long the hand must stay within the tolerance, [s].
        max_duration: Longest simulated time, [s]. None: from how long the skill itself takes.
        noise: Standard deviation of the hand's measured position as the skill sees it, per coordinate, [m].
        target_error: Standard deviation of the perceived target, per horizontal coordinate, [m]; drawn at
            the start, and again when the target moves. The skill, and ``tolerance``, know no other target.
        seed: Of noise, target error, sampling, and the random postures tried in searches.
        scene: What stands in front of the arm. None: nothing.
        cup: The cup, which the hand grasps and lifts when it is at its target. None: none, unless the
            target is the cup.
        grasp: How the hand does that.
        disturbances: What interferes, and when.
        episodes: How many episodes a batch has.
        sampling: What they are drawn from.
    """

    arm: Annotated[str, Field(strict=True)] = "panda"
    tip: Annotated[str, Field(strict=True)] | None = None
    home: Vector | None = None
    start: Vector | None = None
    target: Literal["cup"] | Vector | None = None
    plane: Plane | None = None
    scale: Positive | None = None
    origin: Point | None = None
    hand: HandPolicy | None = None
    base_yaw: Number | None = None
    control: Control = "position"
    max_speed: Positive = 0.3
    max_acceleration: Positive = 1.5
    tolerance: Positive = 2e-3
    settle_time: Positive = 0.5
    max_duration: Positive | None = None
    noise: NotNegative = 0.0
    target_error: NotNegative = 0.0
    seed: Seed = 0
    episodes: Count = 1
    scene: Scene | None = None
    cup: Cup | None = None
    grasp: Grasp = Grasp()
    disturbances: tuple[Disturbance, ...] = ()
    sampling: Sampling = Sampling()

    if not TYPE_CHECKING:  # a type checker takes the keywords from the fields

        def __init__(self, **values: Any) -> None:
            """Check all values.

            Raises:
                UsageError: A value that means nothing; the sentence names it and what was expected.
            """
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise UsageError(complaint(error.errors(include_url=False), KEYS)) from error

    @model_validator(mode="before")
    @classmethod
    def _target_brings_the_cup(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("target") == "cup" and values.get("cup") is None:
            return {**values, "cup": Cup()}
        return values

    @model_validator(mode="after")
    def _fits_together(self) -> Scenario:
        if self.arm not in ARMS and not self.arm.endswith(".urdf"):
            raise ValueError(f"arm: one of {', '.join(ARMS)}, or a file.urdf; not {self.arm!r}.")
        if self.cup is not None and self.scene is None:
            raise ValueError("cup: it needs something to stand on, as in --scene shelf or --scene table.")
        if self.cup is not None and self.scene is not None:
            (front, back), half, (x, y) = self.scene.x_range, 0.5 * self.scene.width, self.cup.place
            if not (front < x < back and -half < y < half):
                raise ValueError(
                    f"cup.position: ({x:g}, {y:g}) is not on a board; those lie at x from {front:g} to "
                    f"{back:g} and y from {-half:g} to {half:g}."
                )
        return self

    @property
    def grasping(self) -> bool:
        """Whether the hand closes at its target and lifts: it does if there is a cup."""
        return self.cup is not None

    def changed(self, **values: Any) -> Scenario:
        """Return this scenario with some values changed, checked as any.

        Raises:
            UsageError: A value that means nothing.
        """
        return Scenario(**{**{name: getattr(self, name) for name in type(self).model_fields}, **values})


PARTS = (Scenario, Shelf, Table, Cup, Grasp, Push, MoveTarget, Displace, Sampling)
KEYS = frozenset(name for part in PARTS for name in part.model_fields)
