"""``skillctl verify-stability``."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from skillctl.cli import options, render, reports, words
from skillctl.cli.errors import Failure, describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output
from skillctl.errors import UsageError
from skillctl.options import option
from skillctl.stability.requirements import REQUIRED, Requirements

if TYPE_CHECKING:
    from skillctl.stability.reach import Reach
    from skillctl.usecases.verify_stability import SkillVerdict, VerifyReport

EXAMPLES = """\b
Example:
  skillctl verify-stability reach
  skillctl verify-stability skills/*/*.h5 --period 0.01 --report junit=all.xml
  skillctl verify-stability reach --plot proof.png
  skillctl verify-stability reach --golden
  skillctl verify-stability skills/*/*.h5 --jobs 4
  skillctl verify-stability reach --start-box 0.4:0.5,0,0.5 --stay-in :0.8,,0:
  skillctl verify-stability *.h5 --format github --report sarif=all.sarif

Exit codes: 0 the requirement is proved of every skill; 1 it is not proved of one, or one is not signed;
3 it is open for one and refuted for none. If skills cannot be read, the largest of their codes counts
instead: 8 disk, 7 refused, 4 not found."""

REPORTS = "Reports"


@dataclass(frozen=True)
class Reporting:
    """What else is checked, and where and how the verdicts are reported."""

    require_signature: Path | None = option(
        metavar="PUBLIC.pem",
        group=REQUIRED,
        help="Key that must have signed each skill; see `skillctl sign`.",
    )
    report: tuple[tuple[str, Path], ...] = option(
        (),
        repeated=True,
        read=reports.read_report,
        metavar="junit|json|sarif=FILE",
        group=REPORTS,
        help="Write a report; give it again for more. It is written whatever is wrong with a skill.",
    )
    scene: Path | None = option(
        metavar="F.toml",
        group=REPORTS,
        help="Say which bodies of a scenario file the hand is proved clear of, at its target there.",
    )
    task: Path | None = option(
        metavar="T.toml",
        group=REQUIRED,
        help="Every clause of this task has to hold of motions from its start box; see `adapt`.",
    )
    golden: bool = option(
        False,
        group=REQUIRED,
        help="Every skill has to agree with the motions that were recorded where it was made.",
    )
    plot: Path | None = option(
        metavar="F.png|svg|pdf", group=REPORTS, help="Draw where and how fast V shrinks."
    )
    form: Literal["text", "github"] = option(
        "text", name="format", group=REPORTS, help="text: a table; github: annotations of a workflow."
    )


def verify_stability(
    context: typer.Context,
    skills: options.Skills,
    *,
    required: Requirements,
    reporting: Reporting,
    work: options.Work,
    place: options.LockedPlace,
) -> None:
    """Prove, from the stored numbers alone, that skills reach their target from everywhere.

    Every skill is checked, even if another cannot be read. Rates are proved lower bounds in 1/s. The period
    is the longest at which a controller may step; it is proved, too. With a start box, it is also proved
    where undisturbed motions from it can go, and by when they have arrived.
    """
    from skillctl.plotting.formats import require_few, require_picture
    from skillctl.store import read_public_key
    from skillctl.usecases.verify_stability import verify_stability as verify_skills

    output: Output = context.obj
    if output.as_json and reporting.form != "text":
        raise UsageError("--json and --format exclude each other.", hint="Add --report json=FILE instead.")
    reports.require_own_files(reporting.report)
    plot, signer = reporting.plot, reporting.require_signature
    if plot is not None:
        require_picture(plot)
        require_few(len(skills))
    if signer is not None:
        required = replace(required, signer=read_public_key(signer))
    workers = work.workers()
    with output.progress("proving") if len(skills) > 1 or work.scheduler else nullcontext() as progress:
        verified = verify_skills(
            skills,
            store=place.store,
            lock=place.lock,
            required=required,
            scene=reporting.scene,
            task=reporting.task,
            golden=reporting.golden,
            workers=workers,
            progress=progress,
        )
    reports.write_reports(verified, reporting.report)
    if plot is not None:
        from skillctl.usecases.pictures import picture_proofs  # late: only pictures need Matplotlib

        picture_proofs(verified, plot)
    if reporting.form == "github":
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
    headings = ["skill", "verdict", "required", "scope", "rate", "period"]
    headings += ["controller ≥", "components", "digest"]
    rows = [row for verdict in report.skills for row in _rows(verdict)]
    if not _asked(report):  # the verdict is about exactly what is required
        for row in (headings, *rows):
            del row[2]
    bounds = [
        block
        for verdict in report.skills
        if verdict.reach is not None
        for block in _bounds(verdict.skill, verdict.reach, report.required)
    ]
    scenes = [block for verdict in report.skills for block in _among(verdict)]
    courses = [block for verdict in report.skills for block in _course(verdict)]
    repeats = [(each.skill, f"golden motions: {each.golden.said}") for each in report.skills if each.golden]
    agreed = [render.Facts(tuple(repeats))] if repeats else []
    tasks = [words.clauses(each.task, each.skill) for each in report.skills if each.task is not None]
    table = render.Table(tuple(headings), tuple(map(tuple, rows)))
    return [table, *courses, *bounds, *scenes, *agreed, *tasks, *_explanations(report)]


def _course(verdict: SkillVerdict) -> list[render.Block]:
    """Return what is proved of a chain beside its parts, which have rows in the table."""
    certificate = verdict.certificate
    if certificate is None or certificate.course is None:
        return []
    told = tuple(sentence for sentence in certificate.proof if not sentence.startswith("Part "))
    return [render.Lines(f"{verdict.skill} is a chain", told)]


def _among(verdict: SkillVerdict) -> list[render.Block]:
    """Return what the hand is proved clear of, if a scene was given."""
    found = verdict.clearance
    if found is None:
        return []
    facts = (
        ("the hand is proved clear of", ", ".join(found.clear) or "nothing"),
        ("it may meet", ", ".join(found.may_meet) or "nothing else that the scene names"),
    )
    return [render.Facts(facts), render.Lines(f"{verdict.skill} in this scene", found.proof)]


def _bounds(name: str, reach: Reach, required: Requirements) -> tuple[render.Block, ...]:
    """Return where motions from the start box go, proved and sampled, and when they arrive."""
    from skillctl.stability.report import at_least, at_most

    measured = reach.measured
    columns = {
        name: reach.names,
        "starts": map(_range, reach.start_low, reach.start_high),
        "never leaves": [
            f"{at_least(low)} … {at_most(high)}" for low, high in zip(reach.low, reach.high, strict=True)
        ],
        "sampled": map(_range, measured.low, measured.high),
    }
    if required.stay_in is not None:
        columns["must stay in"] = [_range(*ends) for ends in required.stay_in]
    seen = f"{measured.arrived} of {measured.starts} sampled motions"
    times = "" if measured.arrival is None else f" after {measured.arrival:.3g} s"
    bound = "–" if reach.arrival is None else f"{at_most(reach.arrival)} s"
    facts = (
        ("holds", "without disturbances, and between samples, too"),
        (
            "arrives at the latest",
            f"after {bound}, at every controller period up to {at_least(reach.period)} s",
        ),
        ("sampled", f"{seen} arrived{times}"),
    )
    return render.Table(tuple(columns), tuple(zip(*columns.values(), strict=True))), render.Facts(facts)


def _range(low: float, high: float) -> str:
    return f"{low:.3g} … {high:.3g}"


def _rows(verdict: SkillVerdict) -> list[list[str]]:
    """Return the row of a skill, one of each of its parts if it has several, and those of their blocks."""
    certificate = verdict.certificate
    if certificate is None:
        return [[verdict.skill, "unreadable", *["–"] * 7]]
    counts = [len(part.components) for part in certificate.parts]
    figures = words.rate_and_period(certificate.rate, certificate.period)
    scope = f"{certificate.scope}{', all weights' if certificate.all_weights else ''}"
    said = certificate.verdict, verdict.outcome, scope
    rows = [[verdict.skill, *said, *figures, str(sum(counts)), words.short(verdict.digest)]]
    course = () if certificate.course is None else certificate.course.stages
    stages = {part: f", stage {stage.stage}" for stage in course for part in stage.parts}
    for part, count in zip(certificate.parts, counts, strict=True):
        if len(counts) > 1:
            proved = "stable" if part.proved else "not proved"
            figures = words.rate_and_period(part.rate, part.period)
            name = f"  part {part.part}{stages.get(part.part, '')}"
            rows.append([name, proved, "", "", *figures, str(count), ""])
        for block in part.blocks:
            figures = words.rate_and_period(block.rate, block.period)
            rows.append([f"  {'  ' * (len(counts) > 1)}{block.name}", "", "", "", *figures, "", ""])
    return rows


def _explanations(report: VerifyReport) -> list[render.Block]:
    """Return what is required and not proved, and why: leaf, component, and what sampling shows."""
    asked, found = _asked(report), []
    for verdict in report.skills:
        certificate, outcome = verdict.certificate, str(verdict.outcome)
        if certificate is not None and (verdict.unmet or certificate.verdict != "stable"):
            if asked and outcome in ("proved", "not proved"):
                outcome = f"what is required is {outcome}"
            unmet = verdict.unmet if asked else ()
            sentences = (*unmet, *certificate.failures, *certificate.evidence)
            found.append(render.Lines(f"{verdict.skill}: {outcome}", sentences))
    return [*found]


def _asked(report: VerifyReport) -> bool:
    """Return whether more, or less, is required than usual."""
    usual = replace(report.required, start_box=None, stay_in=None) == Requirements()
    return (
        not usual
        or report.golden
        or bool(report.required.stay_in)
        or any(each.task for each in report.skills)
    )
