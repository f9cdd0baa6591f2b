"""``skillctl verify-stability``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.errors import Failure, describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.verify_stability import SkillVerdict, VerifyReport

EXAMPLES = """\b
Example:
  skillctl verify-stability reach
  skillctl verify-stability skills/*/*.h5 --json

Exit codes: 0 all are proved stable; 1 one is not proved; 3 none is refuted, but one is open; and before
all of these, the code of the worst skill that could not be read: 8 disk, 7 refused, 4 not found."""


def verify_stability(context: typer.Context, skills: options.Skills, store: options.Store = None) -> None:
    """Prove, from the stored numbers alone, that skills reach their target from everywhere.

    Every skill is checked, whatever is wrong with another. Rates are proved lower bounds in 1/s; the period
    is the longest at which a controller may step, proved too.
    """
    from skillctl.usecases.verify_stability import verify_stability as verify_skills

    output: Output = context.obj
    report = verify_skills(skills, store=store)
    output.result(report, lambda: blocks(report))
    failures = [describe(verdict.error) for verdict in report.skills if verdict.error is not None]
    output.failures(failures, len(report.skills))
    raise typer.Exit(exit_code(report, failures))


def exit_code(report: VerifyReport, failures: list[Failure]) -> ExitCode:
    """Return the one code for many skills; see the end of the help."""
    if failures:
        return max(failure.code for failure in failures)
    verdicts = {verdict.certificate.verdict for verdict in report.skills if verdict.certificate is not None}
    if "not proved" in verdicts:
        return ExitCode.NEGATIVE
    return ExitCode.INCONCLUSIVE if "inconclusive" in verdicts else ExitCode.DONE


def blocks(report: VerifyReport) -> list[render.Block]:
    """Return the report for people."""
    headings = ("skill", "verdict", "scope", "rate", "period", "controller ≥", "components", "digest")
    rows = tuple(row for verdict in report.skills for row in _rows(verdict))
    return [render.Table(headings, rows), *_explanations(report)]


def _rows(verdict: SkillVerdict) -> list[tuple[str, ...]]:
    certificate = verdict.certificate
    if certificate is None:
        return [(verdict.skill, "unreadable", *["–"] * 6)]
    components = sum(len(part.components) for part in certificate.parts)
    whole = (
        verdict.skill,
        certificate.verdict,
        certificate.scope,
        *words.rate_and_period(certificate.rate, certificate.period),
        str(components),
        words.short(verdict.digest),
    )
    if len(certificate.parts) == 1:
        return [whole]
    parts = [
        (
            f"  part {part.part}",
            "stable" if part.proved else "not proved",
            "",
            *words.rate_and_period(part.rate, part.period),
            str(len(part.components)),
            "",
        )
        for part in certificate.parts
    ]
    return [whole, *parts]


def _explanations(report: VerifyReport) -> list[render.Block]:
    """Return why anything is not proved: leaf, component, and what sampling shows."""
    return [
        render.Lines(
            f"{verdict.skill}: {certificate.verdict}", (*certificate.failures, *certificate.evidence)
        )
        for verdict in report.skills
        if (certificate := verdict.certificate) is not None and certificate.verdict != "stable"
    ]
