"""``skillctl lock``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.store import LockedSkill
    from skillctl.usecases.lock import LockReport

EXAMPLES = """\b
Example:
  skillctl lock reach shelf@release
  skillctl lock --check
  skillctl verify-stability reach --locked

Exit codes: 0 locked, or with --check nothing would change; 1 with --check something would."""


def lock(
    context: typer.Context,
    skills: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SKILL...]", help=f"{options.SKILL}."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit 1 if the lock would change.")
    ] = False,
    file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The lock. Default: $SKILLCTL_LOCK, else the nearest skillctl.lock upwards from here, else "
            "a new one here.",
        ),
    ] = None,
    *,
    place: options.Place,
) -> None:
    """Write down which skills a pipeline uses: name, version and content digest of each.

    With --locked other commands use nothing else, and a name means the version that was locked. Without SKILL
    the references in the lock are resolved again; if there is no lock, the newest version of every skill of
    the store is locked.
    """
    from skillctl.usecases.lock import lock as lock_skills

    output: Output = context.obj
    report = lock_skills(skills or (), path=file, check=check, store=place.store)
    output.result(report, lambda: blocks(report, check))
    if check and report.changes:
        raise typer.Exit(ExitCode.NEGATIVE)


def blocks(report: LockReport, check: bool = False) -> list[render.Block]:
    """Return the report for people: what is locked, or with ``check`` what would change."""
    where = words.near(report.path)
    if not check:
        rows = tuple((skill.reference, skill.skill, words.short(skill.digest)) for skill in report.skills)
        said = "written" if report.written else "unchanged"
        return [render.Table(("reference", "skill", "digest"), rows), f"{where}: {said}"]
    if not report.changes:
        return [f"{where}: nothing would change"]
    rows = tuple((change.reference, _shown(change.before), _shown(change.after)) for change in report.changes)
    return [render.Table(("reference", "locked", "would be"), rows), f"{where}: not up to date"]


def _shown(skill: LockedSkill | None) -> str:
    return words.NONE if skill is None else f"{skill.skill}  {words.short(skill.digest)}"
