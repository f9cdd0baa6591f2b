"""``skillctl export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.codegen.check import Check

EXAMPLES = """\b
Example:
  skillctl export reach -o reach.mat
  skillctl export shelf -o shelf.npz
  skillctl export top-left --leaf 2 -o second.mat
  skillctl export shelf --format c99 --check -o shelf.h"""


def export(
    context: typer.Context,
    skill: options.Skill,
    output_file: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="FILE.h, FILE.mat, FILE.json or FILE.npz.")
    ],
    leaf: Annotated[
        int | None,
        typer.Option(metavar="N", help="For .mat: which leaf of a merged or combined skill, from 1."),
    ] = None,
    form: Annotated[
        Literal["c99", "mat", "json", "npz"] | None,
        typer.Option("--format", help="Default: what the ending of the file says; .h is c99."),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="For c99: compile the header, and compare it with the skill first."),
    ] = False,
    *,
    place: options.LockedPlace,
) -> None:
    """Write a skill for other programs.

    FILE.mat: Priors, Mu and Sigma as MATLAB's SEDS tools have them, the target at the origin. FILE.json and
    FILE.npz: every array of the artifact and its metadata. FILE.h: the controller of the skill in C99, for
    robots without Python. With --check it is compiled, with $CC and $CXX or what compilers there are, and
    stepped through 10,000 states; if a command differs, nothing is written, and the exit code is 1.
    """
    from skillctl.usecases.export import export as export_skill

    output: Output = context.obj
    report = export_skill(
        skill, output_file, leaf=leaf, form=form, check=check, store=place.store, lock=place.lock
    )
    compared, problem = report.check, report.check.problem if report.check else ""
    facts = [
        ("skill", report.skill),
        ("file", "not written" if problem else words.near(report.path)),
        ("holds", ", ".join(report.variables)),
    ]
    if compared is not None:
        facts.append(("checked", problem or _agreement(compared)))
    output.result(report, lambda: [render.Facts(tuple(facts))])
    if problem:
        raise typer.Exit(ExitCode.NEGATIVE)


def _agreement(check: Check) -> str:
    """Return how a header compares with its skill."""
    delicate = f", at {check.delicate} beside what its last bits change" if check.delicate else ""
    return (
        f"with {' and '.join(check.compilers)}: at {check.states:,} states its commands are those of the "
        f"skill, to {check.difference:.1e} of each{delicate}; {check.nanoseconds:.0f} ns a step"
    )
