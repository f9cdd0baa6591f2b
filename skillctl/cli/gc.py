"""``skillctl gc``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillctl.cli import options
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl gc --keep-last 5 --keep-tagged --dry-run
  skillctl gc reach --keep-last 1"""


def gc(
    context: typer.Context,
    keep_last: Annotated[
        int, typer.Option(metavar="N", help="Keep the N newest versions of each skill, at least 1.")
    ],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME...]", help="Only these skills. Default: all.")
    ] = None,
    keep_tagged: Annotated[
        bool, typer.Option("--keep-tagged", help="Keep versions that have an alias, too.")
    ] = False,
    dry_run: options.DryRun = False,
    *,
    place: options.Place,
) -> None:
    """Remove all but the newest versions of the skills of the store.

    The numbers of removed versions are not given again. Without --keep-tagged aliases go with their versions.
    """
    from skillctl.cli.rm import blocks
    from skillctl.usecases.versions import collect

    output: Output = context.obj
    report = collect(
        names or (), keep_last=keep_last, keep_tagged=keep_tagged, dry_run=dry_run, store=place.store
    )
    output.result(report, lambda: blocks(report))
