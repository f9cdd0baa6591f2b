"""``skillctl untag``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillctl.cli import options
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl untag reach release"""


def untag(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="A skill of the store.")],
    alias: options.Alias,
    *,
    place: options.Place,
) -> None:
    """Remove an alias; the version that it named stays."""
    from skillctl.usecases.versions import untag as untag_version

    output: Output = context.obj
    report = untag_version(name, alias, store=place.store)
    output.result(report, lambda: [f"{name}@{alias} was {report.skill}; the alias is removed"])
