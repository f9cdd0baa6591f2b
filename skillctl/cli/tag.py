"""``skillctl tag``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillctl.cli import options
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl tag reach@3 release
  skillctl simulate reach@release
  skillctl tag reach@champion release"""


def tag(
    context: typer.Context,
    skill: Annotated[
        str,
        typer.Argument(metavar="SKILL", help="NAME (its newest version), NAME@3, NAME@ALIAS, NAME@sha256:…"),
    ],
    alias: options.Alias,
    *,
    place: options.Place,
) -> None:
    """Give a version of the store an alias; its name is then NAME@ALIAS.

    An alias that names another version is moved. Aliases are kept as text, in refs.toml beside the versions.
    """
    from skillctl.usecases.versions import tag as tag_version

    output: Output = context.obj
    report = tag_version(skill, alias, store=place.store)
    moved = "" if report.before in (None, report.skill) else f" (it was {report.before})"
    name = report.skill.partition("@")[0]
    output.result(report, lambda: [f"{name}@{alias} is {report.skill}{moved}"])
