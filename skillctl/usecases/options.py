"""What a user may choose about skills that are made, whatever they are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from skillctl.demonstrations.options import READING
from skillctl.errors import UsageError
from skillctl.options import RESULT, option
from skillctl.simulation.arms import ARMS


@dataclass(frozen=True)
class Result:
    """Where a new skill goes, and what is written with it.

    Attributes:
        output, name: A file, or a skill of the store to publish the next version of: one of them.
        message: Kept in the skill.
        plot: Picture to draw.
    """

    output: Path | None = option(short="-o", metavar="FILE.h5", group=RESULT, help="Write this file.")
    name: str | None = option(
        metavar="NAME", group=RESULT, help="Publish it in the store as the next version of NAME."
    )
    message: str | None = option(
        short="-m", metavar="TEXT", group=RESULT, help="A note to keep in the skill; `log` shows it."
    )
    plot: Path | None = option(
        metavar="F.png|svg|pdf", group=RESULT, help="Draw it; the suffix decides the format."
    )


@dataclass(frozen=True)
class Robot:
    """The arm whose joints were recorded, if the files hold joints.

    Attributes:
        arm: A name in ``ARMS``, or a URDF file.
        tip: Link of an arm by file whose positions are learned.
        package: Folders whose meshes an arm by file may name.
    """

    arm: str | None = option(
        metavar="|".join([*ARMS, "FILE.urdf"]),
        group=READING,
        help="The files hold the joints of this arm: learn positions of its hand, from its base.",
    )
    tip: str | None = option(
        metavar="LINK", group=READING, help="Hand of an arm by file. Default: as in `simulate`."
    )
    package: tuple[str, ...] = option(
        (),
        repeated=True,
        metavar="DIR",
        group=READING,
        help="Let an arm by file name meshes in DIR, too, as in `simulate`.",
    )

    def __post_init__(self) -> None:
        if self.tip is not None and self.arm is None:
            raise UsageError("tip: it is a link of the arm that was recorded.", hint="Add --arm FILE.urdf.")
        if self.package and self.arm is None:
            raise UsageError("package: it is for the arm that was recorded.", hint="Add --arm FILE.urdf.")

    @property
    def files(self) -> tuple[Path, ...]:
        """The file of the arm, if it has one."""
        return () if self.arm is None or self.arm in ARMS else (Path(self.arm),)

    def recorded(self) -> dict[str, str]:
        """What is kept of it in a skill; the content of a file is, as of all inputs."""
        arm = None if self.arm is None else Path(self.arm).name
        return {key: value for key, value in {"arm": arm, "tip": self.tip}.items() if value is not None}

    def beside(self, folder: Path) -> Robot:
        """Return the same with the file and its packages relative to a folder."""
        if not self.files:
            return self
        package = tuple(str(folder / each) for each in self.package)
        return replace(self, arm=str(folder / self.files[0]), package=package)


@dataclass(frozen=True)
class Validation:
    """Whether a new skill is also judged by demonstrations that it was not learned from.

    Attributes:
        validate: Learn with each demonstration left out, and report the error on it.
    """

    validate: bool = option(
        False,
        group="Learning",
        help="Also learn with each demonstration left out, and report the error on it.",
    )
