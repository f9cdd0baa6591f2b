"""``skillctl verify-stability``."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skillctl.cli import options, render, reports, words
from skillctl.cli.errors import Failure, describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output
from skillctl.errors import UsageError
from skillctl.stability.requirements import REQUIRED, Requirements

if TYPE_CHECKING:
    from skillctl.usecases.verify_stability import SkillVerdict, VerifyReport

EXAMPLES = """\b
Example:
  skillctl verify-stability reach
  skillctl verify-stability skills/*/*.h5 --period 0.01 --report junit=stability.xml
  skillctl verify-stability reach --plot proof.png
  skillctl verify-stability skills/*/*.h5 --jobs 4
  skillctl verify-stability skills/*/*.h5 --format github --report sarif=stability.sarif

Exit codes: 0 what is required is proved of all; 1 of one it is not, or it is not signed; 3 none is refuted,
but one is open; and before all of these, the code of the worst skill that could not be read: 8 disk,
7 refused, 4 not found."""

REPORTS = "Reports"


def verify_stability(
    context: typer.Context,
    skills: options.Skills,
    *,
    required: Requirements,
    require_signature: Annotated[
        Path | None,
        typer.Option(
            metavar="PUBLIC.pem",
            help="This key has signed each skill; see `skillctl sign`.",
            rich_help_panel=REQUIRED,
        ),
    ] = None,
    report: Annotated[
        list[reports.ReportFile] | None,
        typer.Option(
            parser=reports.read_report,
            metavar="junit|json|sarif=FILE",
            help="Write a report; give it again for more. It is written whatever is wrong with a skill.",
            rich_help_panel=REPORTS,
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png|svg|pdf", help="Draw where and how fast V shrinks.", rich_help_panel=REPORTS
        ),
    ] = None,
    form: Annotated[
        Literal["text", "github"],
        typer.Option(
            "--format", help="text: a table; github: annotations of a workflow.", rich_help_panel=REPORTS
        ),
    ] = "text",
    work: options.Work,
    place: options.LockedPlace,
) -> None:
    """Prove, from the stored numbers alone, that skills reach their target from everywhere.

    Every skill is checked, whatever is wrong with another. Rates are proved lower bounds in 1/s; the period
    is the longest at which a controller may step, proved too.
    """
    from skillctl.plotting.formats import require_few, require_picture
    from skillctl.store import read_public_key
    from skillctl.usecases.verify_stability import verify_stability as verify_skills

    output: Output = context.obj
    if output.as_json and form != "text":
        raise UsageError("--json and --format exclude each other.", hint="Add --report json=FILE instead.")
    files = report or []
    reports.require_own_files(files)
    if plot is not None:
        require_picture(plot)
        require_few(len(skills))
    signer = None if require_signature is None else read_public_key(require_signature)
    required = replace(required, signer=signer)
    workers = work.workers()
    with output.progress("proving") if len(skills) > 1 else nullcontext() as progress:
        verified = verify_skills(
            skills, store=place.store, lock=place.lock, required=required, workers=workers, progress=progress
        )
    reports.write_reports(verified, files)
    if plot is not None:
        from skillctl.usecases.pictures import picture_proofs  # late: only pictures need Matplotlib

        picture_proofs(verified, plot)
    if form == "github":
        output.verbatim(reports.github(verified))
    else:
        output.result(verified, lambda: blocks(verified))
    failures = [describe(verdict.error) for verdict in verified.skills if verdict.error is not None]
    output.failures(failures, len(verified.skills))
    raise typer.Exit(exit_code(verified, failures))


def exit_code(report: VerifyReport, failures: list[Failure]) -> ExitCode:
    """Return the one code for many skills; see the end of the help."""
    if failures:
        return max(failure.code for failure in failures)
    outcomes = {verdict.outcome for verdict in report.skills}
    if outcomes & {"not proved", "not signed"}:
        return ExitCode.NEGATIVE
    return ExitCode.INCONCLUSIVE if "inconclusive" in outcomes else ExitCode.DONE


def blocks(report: VerifyReport) -> list[render.Block]:
    """Return the report for people."""
    headings = (
        "skill", "verdict", "required", "scope", "rate", "period", "controller ≥", "components", "digest",
    )  # fmt: skip
    rows = [headings, *(row for verdict in report.skills for row in _rows(verdict))]
    if not _asked(report):  # what the verdict is of is what is required
        rows = [(*row[:2], *row[3:]) for row in rows]
    return [render.Table(rows[0], tuple(rows[1:])), *_explanations(report)]


def _rows(verdict: SkillVerdict) -> list[tuple[str, ...]]:
    certificate = verdict.certificate
    if certificate is None:
        return [(verdict.skill, "unreadable", *["–"] * 7)]
    components = sum(len(part.components) for part in certificate.parts)
    whole = (
        verdict.skill,
        certificate.verdict,
        verdict.outcome,
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
            "",
            *words.rate_and_period(part.rate, part.period),
            str(len(part.components)),
            "",
        )
        for part in certificate.parts
    ]
    return [whole, *parts]


def _explanations(report: VerifyReport) -> list[render.Block]:
    """Return what is required and not proved, and why: leaf, component, and what sampling shows."""
    return [
        render.Lines(
            f"{verdict.skill}: {_told(verdict, report)}",
            (*(verdict.unmet if _asked(report) else ()), *certificate.failures, *certificate.evidence),
        )
        for verdict in report.skills
        if (certificate := verdict.certificate) is not None
        and (verdict.unmet or certificate.verdict != "stable")
    ]


def _told(verdict: SkillVerdict, report: VerifyReport) -> str:
    if _asked(report) and verdict.outcome in ("proved", "not proved"):
        return f"what is required is {verdict.outcome}"
    return verdict.outcome


def _asked(report: VerifyReport) -> bool:
    """Return whether more, or less, is required than what is usual."""
    required = report.required
    return required != type(required)()
