"""``skillctl export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl export reach -o reach.mat
  skillctl export shelf -o shelf.npz
  skillctl export top-left --leaf 2 -o second.mat"""


def export(
    context: typer.Context,
    skill: options.Skill,
    output_file: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="FILE.mat, FILE.json or FILE.npz.")
    ],
    leaf: Annotated[
        int | None,
        typer.Option(metavar="N", help="For .mat: which leaf of a merged or combined skill, from 1."),
    ] = None,
    *,
    place: options.LockedPlace,
) -> None:
    """Write a skill for other programs.

    FILE.mat: Priors, Mu and Sigma as MATLAB's SEDS tools have them, the target at the origin. FILE.json and
    FILE.npz: every array of the artifact and its metadata.
    """
    from skillctl.usecases.export import export as export_skill

    output: Output = context.obj
    report = export_skill(skill, output_file, leaf=leaf, store=place.store, lock=place.lock)
    facts = (
        ("skill", report.skill),
        ("file", words.near(report.path)),
        ("holds", ", ".join(report.variables)),
    )
    output.result(report, lambda: [render.Facts(facts)])
