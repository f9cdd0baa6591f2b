"""What the columns of a table mean, by their names: a position, the time, or neither."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from skillctl.demonstrations.recording import column_indices, listed
from skillctl.demonstrations.units import Unit, split_unit
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

SEPARATORS = " _.:/|-"  # between a thing and its axis
BETWEEN_WORDS = "\0"  # marks where a word begins with a capital letter; no header holds it


@dataclass(frozen=True, slots=True)
class Role:
    """What a column is for.

    Attributes:
        name: Of the role.
        words: A column with one of these words in its name has the role,
        pattern: as has one whose words, joined by spaces, match this.
        has_axes: A column of it can be an axis of a position all the same: ``gripper_x``.
    """

    name: str
    words: str = ""
    pattern: str = "(?!)"
    has_axes: bool = False

    def fits(self, words: Sequence[str]) -> bool:
        """Return whether a column with a name of these words has the role."""
        return not set(self.words.split()).isdisjoint(words) or bool(
            re.fullmatch(self.pattern, " ".join(words))
        )


ROLES = (  # the first that fits
    Role(
        "time",
        "time times timestamp timestamps stamp stamps datetime clock elapsed epoch utc zeit temps tiempo",
        "t|tv|(.* )?ts|",
    ),
    Role(
        "demonstration",
        pattern="(demo|demonstration|trial|episode|repetition|rep|traj|trajectory|take|run)"
        "( (id|idx|index|nr|no|num|number))?",
    ),
    Role(
        "velocity",
        "vel velocity velocities linvel angvel speed speeds twist acc accel acceleration jerk omega qd qdot "
        "dq gyro imu dot xdot ydot zdot",
        "(.* )?(v|w|a|d|dt)[xyz]|(.* )?v( .*)? [xyz]",
    ),
    Role(
        "force",
        "force forces torque torques wrench effort efforts ft tau currents voltage",
        "(.* )?f[xyz]",
    ),
    Role("quality", "error residual confidence likelihood covariance cov std variance valid quality"),
    Role("gripper", "gripper grip finger fingers jaw width opening aperture button trigger", has_axes=True),
    Role(
        "joint",
        "joint joints",
        r"(.* )?((q|qpos|j|axis|position|pos|angle|motor|servo|theta)s? \d+|"
        r"(shoulder|elbow|wrist|waist|forearm)( (pan|lift|flex|roll|yaw|pitch|rotate|rotation|\d+))?)"
        "( (pos|position|angle))?",
        has_axes=True,
    ),
    Role(
        "orientation",
        "quat quats quaternion quaternions orientation orientations orient ori rotation rotations rot euler "
        "rpy roll pitch yaw rotvec heading theta phi psi ang angle angles",
        "(.* )?[qro][xyzw]|(.* )?q( .*)? [wxyz]",
    ),
    Role(
        "counter",
        pattern="(.* )?(frame|frames|subframe|index|idx|seq|sequence|id|row|sample|samples|step|timestep|"
        "count|counter|tick|ticks|n|nr|no|number|line|iteration|unnamed 0)",
    ),
)
OTHER = Role("", has_axes=True)
AXIS_IN_WORD = re.compile("(?:t|p|pos|position|trans|translation|loc)([xyz])|([xyz])pos(?:ition)?")
POSES = {"pose", "tcp"}  # numbered columns: a position, and an orientation behind it
MATRIX = (16, (12, 13, 14))  # numbered columns of a 4 × 4 matrix, column by column, and those of its position
PLACES = {*POSES, "pos", "position", "xyz", "translation", "eef", "ee"}  # three numbered columns: a position


@dataclass(frozen=True)
class Column:
    """A column of a table, by its name; ``said`` is the unit if another place says it."""

    name: str
    said: Unit | None = None

    @cached_property
    def _split(self) -> tuple[str, Unit | None]:
        return split_unit(self.name.strip())

    @property
    def stem(self) -> str:
        """The name without a unit."""
        return self._split[0]

    @property
    def unit(self) -> Unit | None:
        """The unit that the name says, or else the table."""
        return self._split[1] or self.said

    @cached_property
    def words(self) -> tuple[str, ...]:
        """The words of the name, in small letters: hand, right, x of ``HandRight_X``; j, 1 of ``j1``."""
        return tuple(re.findall(r"[^\W\d_]+|\d+", self._apart.lower()))

    @property
    def _apart(self) -> str:
        return re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z])", BETWEEN_WORDS, self.stem)

    @cached_property
    def role(self) -> Role:
        """What the column is for."""
        if not self.words and (self.unit is None or self.unit.base != "s"):
            return OTHER
        return next((role for role in ROLES if role.fits(self.words)), OTHER)

    @cached_property
    def axis(self) -> tuple[str, str] | None:
        """What moves, and the axis: HandRight and x of ``HandRight_X``; None if the column is no axis."""
        if not self.role.has_axes or not self.words:
            return None
        if len(found := [word for word in self.words if word in AXIS_NAMES]) == 1:
            around = re.split(rf"(?<![^\W\d_]){found[0]}(?![^\W\d_])", self._apart, flags=re.IGNORECASE)
            left = filter(None, (part.strip(SEPARATORS + BETWEEN_WORDS) for part in around))
            return " ".join(left).replace(BETWEEN_WORDS, ""), found[0]
        if match := AXIS_IN_WORD.fullmatch(self.words[-1]):
            word = self.words[-1]
            thing = self.stem[: -len(word)] + word.replace(match[1] or match[2], "", 1)
            return thing.strip(SEPARATORS), match[1] or match[2]
        stem, last = self.stem[:-1].strip(SEPARATORS), self.stem[-1:].lower()
        return (stem, last) if last in AXIS_NAMES and len(stem) > 1 else None


def positions(columns: Sequence[Column]) -> dict[str, tuple[int, ...]]:
    """Return the columns x, y (and z) of each thing that moves, by its name; the name of plain x, y is empty.

    ``HandRight_X``, ``HandRight.x`` or ``HandRightX`` is a column of HandRight if there is such a column for
    y, too. Of the numbered columns of a pose, ``tcp_pose_0`` …, the first three are the position; of those of
    a transform, ``O_T_EE[0]`` …, which libfranka writes column by column, the last but one.
    """
    found: dict[str, dict[str, int]] = {}
    for index, column in enumerate(columns):
        if column.axis is not None:
            found.setdefault(column.axis[0], {}).setdefault(column.axis[1], index)
    things = {}
    for thing, by_axis in found.items():
        axes = AXIS_NAMES if "z" in by_axis else AXIS_NAMES[:2]
        if set(axes) <= set(by_axis):
            things[thing] = tuple(by_axis[axis] for axis in axes)
    return {**things, **dict(_numbered(columns))}


def _numbered(columns: Sequence[Column]) -> Iterator[tuple[str, tuple[int, ...]]]:
    families: dict[tuple[str, ...], list[int]] = {}
    for index, column in enumerate(columns):
        if column.words[-1:] and column.words[-1].isdigit() and (column.role.has_axes):
            families.setdefault(column.words[:-1], []).append(index)
    for words, family in families.items():
        if len(family) == MATRIX[0] and "t" in words:
            yield _stem(columns[family[0]]), tuple(family[i] for i in MATRIX[1])
        if (len(family) in (6, 7) and POSES & set(words)) or (len(family) == 3 and PLACES & set(words)):
            yield _stem(columns[family[0]]), tuple(family[:3])


def _stem(column: Column) -> str:
    """Return the name of a numbered column without its number."""
    return column.stem.rstrip("0123456789[]()" + SEPARATORS)


def chosen(wanted: Sequence[str], columns: Sequence[Column], path: Path) -> tuple[int, ...]:
    """Return the indices of the wanted columns; a thing that moves means all of its columns.

    A column can be named without its unit.

    Raises:
        UsageError: A column is named twice, or none is.
        InputDataError: A name is neither; the message suggests the nearest one.
    """
    names = [column.name for column in columns]
    stems = {column.stem: index for index, column in enumerate(columns) if column.stem}
    known = {**stems, **{name: names.index(name) for name in names}}
    things = {thing: found for thing, found in positions(columns).items() if thing not in known}
    everything = dict.fromkeys(filter(None, [*things, *names, *stems]))
    column_indices(wanted, tuple(everything), path)  # refuses
    found = [index for name in wanted for index in (things.get(name) or (known[name],))]
    column_indices([names[index] for index in found], names, path)
    return tuple(found)


def recognised(columns: Sequence[Column], free: Sequence[int], most: int, path: Path) -> tuple[int, ...]:
    """Return the indices of the position: of the one thing that moves, else of joints, else of what is left.

    Columns that are an orientation, a velocity, a force, a gripper or a counter are left aside.

    Args:
        columns: All columns.
        free: Indices of those that are neither time nor demonstration.
        most: Largest number of dimensions.
        path: Of the table, for messages.

    Raises:
        InputDataError: Several things move, or more than ``most`` columns are left: the user has to choose.
    """
    things = positions(columns)
    if "" in things:
        return things[""]
    if len(things) == 1:
        return next(iter(things.values()))
    roles = [columns[index].role.name for index in free]
    joints = [index for index, role in zip(free, roles, strict=True) if role == "joint"]
    plain = [index for index, role in zip(free, roles, strict=True) if role == ""]
    found = joints or plain
    if len(found) <= most and not things:
        return tuple(found)
    if things:
        raise InputDataError(
            f"{path}: {len(free)} columns could be positions; which are?",
            hint=f"Choose with --columns, as in --columns {_quoted(next(iter(things)))}. "
            f"The joints are: {listed(tuple(things), 40)}.",
        )
    names = [columns[index].name for index in found]
    example = printable(",".join(names[:3]))
    raise InputDataError(
        f"{path}: {len(found)} columns could be positions; which are?",
        hint=f"Choose with --columns, as in --columns {example}. The columns are: {listed(names, 40)}.",
    )


def _quoted(name: str) -> str:
    return f"'{printable(name)}'" if " " in name else printable(name)
