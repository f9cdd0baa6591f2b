"""``skillctl ls``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.ls import StoredSkill, StoreReport, VersionEntry

EXAMPLES = """\b
Example:
  skillctl ls
  skillctl ls reach --check
  skillctl ls --store path/to/skills --json

Exit codes: 0 listed; 4 no such store or skill; 7 with --check: a file is damaged, or not a valid skill."""


def ls(
    context: typer.Context,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME...]", help="Show every version of these skills.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Read every file as a whole: seal, layout, metadata, numbers.")
    ] = False,
    *,
    place: options.Place,
) -> None:
    """List the skills of the store: versions, kind, aliases, size and digest.

    Without names there is one line for each skill, about its newest version; --json always lists every
    version. Kind, size and digest are read from the first bytes of a file; verified says whether --check
    found the whole file valid.
    """
    from skillctl.usecases.ls import list_skills

    output: Output = context.obj
    report = list_skills(place.store, names=names or (), check=check)
    output.result(report, lambda: blocks(report, each=bool(names)))
    for skill in report.skills:
        for problem in (skill.problem, *(entry.problem for entry in skill.entries)):
            if problem:
                output.note(f"warning: {problem}")
    if check and any(not entry.verified for skill in report.skills for entry in skill.entries):
        raise typer.Exit(ExitCode.REFUSED)


def blocks(report: StoreReport, each: bool = False) -> list[render.Block]:
    """Return the report for people: a line for each version, or for each skill."""
    if not report.skills:
        return [f"{report.store} holds no skills yet."]
    if each:
        rows = [
            _row(f"{skill.name}@{entry.version}", entry) for skill in report.skills for entry in skill.entries
        ]
        return [render.Table(("skill", *HEADINGS), tuple(rows))]
    return [render.Table(("skill", "versions", *HEADINGS), tuple(map(_summary, report.skills)))]


HEADINGS = ("kind", "aliases", "size", "verified", "digest")


def _summary(skill: StoredSkill) -> tuple[str, ...]:
    """Return the line of the newest version, with the aliases of all versions, and whether all are valid."""
    newest = skill.entries[-1]
    aliases = ", ".join(f"{word}={entry.version}" for entry in skill.entries for word in entry.aliases)
    checked = [entry.verified for entry in skill.entries]
    verified = None if None in checked else all(checked)
    name, kind, _, size, _, digest = _row(f"{skill.name}@{newest.version}", newest)
    return (name, str(len(skill.versions)), kind, aliases or words.NONE, size, words.yes_no(verified), digest)


def _row(name: str, entry: VersionEntry) -> tuple[str, ...]:
    return (
        name,
        entry.kind or "unreadable",
        ", ".join(entry.aliases) or words.NONE,
        words.NONE if entry.bytes is None else f"{entry.bytes / 1024:.1f} KiB",
        words.yes_no(entry.verified),
        words.short(entry.digest),
    )
