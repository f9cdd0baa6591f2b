"""``skillctl ls``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.ls import StoreReport

EXAMPLES = """\b
Example:
  skillctl ls
  skillctl ls --store path/to/skills --json"""


def ls(context: typer.Context, store: options.Store = None) -> None:
    """List the skills of the store: names, versions, and the file of the newest one."""
    from skillctl.usecases.ls import list_skills

    output: Output = context.obj
    report = list_skills(store)
    output.result(report, lambda: blocks(report))


def blocks(report: StoreReport) -> list[render.Block]:
    """Return the report for people."""
    if not report.skills:
        return [f"{report.store} holds no skills yet."]
    rows = tuple(
        (skill.name, str(skill.versions[-1]), str(len(skill.versions)), words.near(skill.path))
        for skill in report.skills
    )
    return [render.Table(("skill", "newest", "versions", "file"), rows)]
