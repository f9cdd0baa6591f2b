"""``skillctl verify-signature``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skillctl.cli import options, render
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl verify-signature reach@3 --key public.pem
  skillctl verify-stability reach@3 --require-signature public.pem

Exit codes: 0 the key has signed what the skill holds now; 1 it has not; 7 the skill, or what is beside it, is
damaged."""


def verify_signature(
    context: typer.Context,
    skill: options.Skill,
    key: Annotated[Path, typer.Option(metavar="PUBLIC.pem", help="The public key, Ed25519.")],
    *,
    place: options.LockedPlace,
) -> None:
    """Say whether a key has signed what a skill holds now."""
    from skillctl.usecases.sign import verify_signature as verify

    output: Output = context.obj
    report = verify(skill, key, store=place.store, lock=place.lock)
    facts = (
        ("skill", report.skill),
        ("digest", report.digest),
        ("public key", report.key),
        ("signature", report.state),
    )
    more = () if report.state == "valid" else (report.explanation,)
    output.result(report, lambda: [render.Facts(facts), *more])
    raise typer.Exit(ExitCode.DONE if report.state == "valid" else ExitCode.NEGATIVE)
