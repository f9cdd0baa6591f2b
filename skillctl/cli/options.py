"""Arguments and options that several commands share, each declared once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, TypeVar

import typer

from skillctl.usecases.ranges import read_ranges

if TYPE_CHECKING:
    from skillctl.store import Lock

INPUT = "Reading the demonstrations"
MOTION = "The motion"
RESULT = "The result"
WORK = "Who does the work"

T = TypeVar("T")

# The choices of the rooms, spelt again because importing a room imports NumPy; a test holds them together.
InputFormat: TypeAlias = Literal["csv", "tum", "npz", "robomimic", "lasa", "lpvds"]
Units: TypeAlias = Literal["m", "mm", "rad"]
Objective: TypeAlias = Literal["reproduction", "mse", "likelihood"]
Metric: TypeAlias = Literal["learned", "euclidean"]
Preset: TypeAlias = Literal["fast", "default", "quality"]
MergeGate: TypeAlias = Literal["superposition", "density", "experts"]
CombineGate: TypeAlias = Literal["latched", "instantaneous"]
Scope: TypeAlias = Literal["global", "local"]
VerdictFormat: TypeAlias = Literal["text", "github"]
FitLevel: TypeAlias = Literal["part", "component"]
ARMS = ("panda", "iiwa", "xarm6")
Plane: TypeAlias = Literal["xy", "xz", "yz"]
Hand: TypeAlias = Literal["horizontal", "down", "free"]
ColourBy: TypeAlias = Literal["outcome", "part"]
BackendName: TypeAlias = Literal["processes", "dask"]


# Classes of their own, because Typer reads tuple[float, ...] as "takes two arguments".
class Numbers(tuple[float, ...]):
    """``1,2.5,-3``."""


class Words(tuple[str, ...]):
    """``x,y,z``."""


class Indices(tuple[int, ...]):
    """``0,2,5-9``."""


def read_numbers(text: str) -> Numbers:
    """Read ``1,2.5,-3``."""
    return Numbers(_listed(text, float, "numbers separated by commas, as in 0.4,0,0.5"))


def read_words(text: str) -> Words:
    """Read ``x,y,z``."""
    return Words(_listed(text, str, "names separated by commas, as in x,y,z"))


def read_indices(text: str) -> Indices:
    """Read ``0,2,5-9``."""
    try:
        return Indices(read_ranges(text))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def read_components(text: str) -> int | Literal["auto"]:
    """Read a number of components, or ``auto``."""
    if text == "auto":
        return "auto"
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is neither a number nor auto.") from None


def chosen_lock(locked: bool) -> Lock | None:
    """Return the lock file if it was asked for."""
    if not locked:
        return None
    from skillctl.store import locate_lock, read_lock

    return read_lock(locate_lock())


def _listed(text: str, read: Callable[[str], T], expected: str) -> list[T]:
    try:
        parts = [part.strip() for part in text.split(",")]
        if "" in parts:
            raise ValueError
        return [read(part) for part in parts]
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of {expected}.") from None


SKILL = "FILE.h5, NAME (its newest version), NAME@3, NAME@ALIAS or NAME@sha256:…"
Skill = Annotated[
    str,
    typer.Argument(metavar="SKILL", help=SKILL),
]
Skills = Annotated[
    list[str],
    typer.Argument(metavar="SKILL...", help=SKILL),
]
Alias = Annotated[str, typer.Argument(metavar="ALIAS", help="A word such as release.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")]
Store = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Where named skills live. Default: $SKILLCTL_STORE, else the nearest skills/ upwards from here, "
        "else the user's data folder.",
    ),
]
Locked = Annotated[
    bool,
    typer.Option(
        "--locked",
        envvar="SKILLCTL_LOCKED",
        help="Use nothing but what the lock file names, in the version it names; see `skillctl lock`.",
    ),
]
OutputFile = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE.h5", help="Write this file.", rich_help_panel=RESULT),
]
Plot = Annotated[
    Path | None,
    typer.Option(
        metavar="F.png|svg|pdf", help="Draw it; the suffix decides the format.", rich_help_panel=RESULT
    ),
]
Name = Annotated[
    str | None,
    typer.Option(
        "--name",
        metavar="NAME",
        help="Publish it in the store as the next version of NAME.",
        rich_help_panel=RESULT,
    ),
]
Message = Annotated[
    str | None,
    typer.Option(
        "--message",
        "-m",
        metavar="TEXT",
        help="A note to keep in the skill; `log` shows it.",
        rich_help_panel=RESULT,
    ),
]
Depfile = Annotated[
    Path | None,
    typer.Option(metavar="F.d", help="Write what FILE.h5 depends on, for Make.", rich_help_panel=RESULT),
]
IfChanged = Annotated[
    bool,
    typer.Option(
        "--if-changed",
        help="Leave the time of FILE.h5 alone if it stays the same, so that nothing is made again from it.",
        rich_help_panel=RESULT,
    ),
]
Explain = Annotated[
    bool, typer.Option("--explain", help="Say why it is not up to date.", rich_help_panel=RESULT)
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Make it again even if nothing changed.", rich_help_panel=RESULT),
]
NoRefit = Annotated[
    bool,
    typer.Option(
        "--no-refit",
        help="Refuse skills that cannot be proved together as they are, instead of learning them again from "
        "the demonstrations they carry.",
        rich_help_panel=MOTION,
    ),
]
Target = Annotated[
    Numbers | None,
    typer.Option(
        parser=read_numbers,
        metavar="X,Y,Z",
        help="Where the motion shall end, in the unit of the skill.",
        rich_help_panel=MOTION,
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", metavar="N", help="Processes; changes no result. Default: 1.", rich_help_panel=WORK
    ),
]
Backend = Annotated[
    BackendName,
    typer.Option(
        help="processes: of this machine; dask: a cluster. (Needs: pip install '.[cluster]'.)",
        rich_help_panel=WORK,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Of the cluster, as `dask scheduler` says it. Its workers see the same directory as we do.",
        rich_help_panel=WORK,
    ),
]
