"""Arguments and options that several commands share, each declared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skillctl.options import MOTION, RESULT, option
from skillctl.usecases.options import Result

if TYPE_CHECKING:
    from skillctl.store import Lock
    from skillctl.workers import Workers

WORK = "Who does the work"

SKILL = "FILE.h5, NAME (its newest version), NAME@3, NAME@ALIAS or NAME@sha256:…"
Skill = Annotated[str, typer.Argument(metavar="SKILL", help=SKILL)]
Skills = Annotated[list[str], typer.Argument(metavar="SKILL...", help=SKILL)]
Alias = Annotated[str, typer.Argument(metavar="ALIAS", help="A word such as release.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")]
NoRefit = Annotated[
    bool,
    typer.Option(
        "--no-refit",
        help="Refuse skills that cannot be proved together as they are, instead of learning them again from "
        "the demonstrations they carry.",
        rich_help_panel=MOTION,
    ),
]


@dataclass(frozen=True)
class Place:
    """Where names are looked up."""

    store: Path | None = option(
        metavar="DIR",
        help="Where named skills live. Default: $SKILLCTL_STORE, else the nearest skills/ upwards from here, "
        "else the user's data folder.",
    )


@dataclass(frozen=True)
class LockedPlace(Place):
    """Where names are looked up, by commands that can be restricted to locked skills."""

    locked: bool = option(
        False,
        environment="SKILLCTL_LOCKED",
        help="Use nothing but what the lock file names, in the version it names; see `skillctl lock`.",
    )

    @cached_property
    def lock(self) -> Lock | None:
        """The lock file if it was asked for."""
        if not self.locked:
            return None
        from skillctl.store import locate_lock, read_lock

        return read_lock(locate_lock())


@dataclass(frozen=True)
class Making(Result):
    """Where a new skill goes, and when it is made again."""

    depfile: Path | None = option(
        metavar="F.d", group=RESULT, help="Write what FILE.h5 depends on, for Make."
    )
    if_changed: bool = option(
        False,
        group=RESULT,
        help="Leave the time of FILE.h5 alone if it stays the same, so that nothing is made again from it.",
    )
    explain: bool = option(False, group=RESULT, help="Say why the skill is not up to date.")
    force: bool = option(False, group=RESULT, help="Make it again even if nothing changed.")


@dataclass(frozen=True)
class Work:
    """How the work on many items is shared."""

    jobs: int | None = option(
        short="-j", metavar="N", group=WORK, help="Number of processes; it changes no result. Default: 1."
    )
    backend: Literal["processes", "dask"] = option(
        "processes",
        group=WORK,
        help="processes: on this machine; dask: on a cluster. (Needs: pip install distributed.)",
    )
    scheduler: str | None = option(
        metavar="ADDRESS",
        group=WORK,
        help="Address of a cluster, as `dask scheduler` prints it. Its workers must see this directory.",
    )
    patience: float | None = option(
        metavar="S",
        group=WORK,
        help="Stop when the scheduler, or all workers of the cluster, have given no sign of life for this "
        "long. Default: 60.",
    )

    def workers(self) -> Workers:
        """Return the processes that do the work.

        Raises:
            UsageError: The options contradict each other.
        """
        from skillctl.workers import Workers

        return Workers.chosen(self.jobs, self.backend, self.scheduler, self.patience)
