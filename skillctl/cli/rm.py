"""``skillctl rm``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.versions import RemoveReport

EXAMPLES = """\b
Example:
  skillctl rm reach@1 reach@2
  skillctl rm --all old-reach --dry-run"""


def rm(
    context: typer.Context,
    skills: Annotated[
        list[str],
        typer.Argument(metavar="SKILL...", help="NAME@3, NAME@ALIAS, NAME@sha256:…; with --all NAME."),
    ],
    every: Annotated[bool, typer.Option("--all", help="Remove every version of the skills.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Also versions that have an alias, and the alias with them.")
    ] = False,
    dry_run: options.DryRun = False,
    *,
    place: options.Place,
) -> None:
    """Remove versions from the store. Their numbers are not given to other versions later.

    Nothing is removed unless all of them exist.
    """
    from skillctl.usecases.versions import remove

    output: Output = context.obj
    report = remove(skills, all_versions=every, force=force, dry_run=dry_run, store=place.store)
    output.result(report, lambda: blocks(report))


def blocks(report: RemoveReport) -> list[render.Block]:
    """Return the report for people."""
    verb = "would be removed" if report.dry_run else "removed"
    title = f"{len(report.removed)} versions {verb}, {report.kept} kept"
    lines = (
        each.skill + (f" ({', '.join(each.aliases)})" if each.aliases else "") for each in report.removed
    )
    return [render.Lines(title, tuple(lines))]
