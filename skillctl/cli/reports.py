"""Verdicts for machines that run checks: JUnit XML, SARIF, JSON, and annotations of GitHub's workflows."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import typer

import skillctl
from skillctl.cli import render
from skillctl.cli.errors import describe
from skillctl.errors import UsageError, printable

if TYPE_CHECKING:
    from skillctl.usecases.verify_stability import SkillVerdict, VerifyReport

NAME = "skillctl verify-stability"
SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
RULES = {
    "not proved": ("SKILL001", "The skill is not proved to reach its target as required.", "error"),
    "inconclusive": ("SKILL002", "Whether the skill reaches its target is open.", "warning"),
    "not signed": ("SKILL004", "The skill does not have the required signature.", "error"),
    "unreadable": ("SKILL003", "The skill cannot be read.", "error"),
    "proved": ("SKILL000", "The skill is proved to reach its target as required.", "none"),
}


class ReportFile(tuple[str, Path]):
    """``junit=F``: the form of a report and its file."""


def read_report(text: str) -> ReportFile:
    """Read ``junit=FILE``."""
    form, equals, path = text.partition("=")
    if form not in WRITERS or not (equals and path):
        raise typer.BadParameter(f"{text!r} is not one of {', '.join(f'{form}=FILE' for form in WRITERS)}.")
    return ReportFile((form, Path(path)))


def write_reports(report: VerifyReport, files: list[ReportFile]) -> None:
    """Write every report, each whole or not at all.

    Raises:
        UsageError: Two reports in one file.
        StoreError: A file cannot be written.
    """
    from skillctl.store import write_file

    require_own_files(files)
    for form, path in files:
        write_file(path, WRITERS[form](report).encode())


def require_own_files(files: list[ReportFile]) -> None:
    """Raise UsageError if two reports would be written to one file."""
    paths = [os.path.realpath(path) for _, path in files]
    if len(set(paths)) < len(paths):
        raise UsageError("report: two reports in one file.", hint="Give each report a file of its own.")


def github(report: VerifyReport) -> str:
    """Return one workflow command per skill that is not proved, and a line that counts them.

    References:
        GitHub Docs, workflow commands for GitHub Actions: setting an error message.
    """
    lines = [
        f"::{'warning' if verdict.outcome == 'inconclusive' else 'error'} "
        f"file={_property(_location(verdict))},title={_property(f'{NAME}: {verdict.outcome}')}::"
        f"{_data(f'{verdict.skill}: {reason(verdict)} [{identity(verdict)}]')}"
        for verdict in report.skills
        if verdict.outcome != "proved"
    ]
    proved = len(report.skills) - len(lines)
    return "".join(f"{line}\n" for line in [*lines, f"{proved} of {len(report.skills)} skills proved."])


def junit(report: VerifyReport) -> str:
    """Return one test case per skill: failed if not proved or open, in error if it cannot be read."""
    from xml.etree import ElementTree

    outcomes = [verdict.outcome for verdict in report.skills]
    errors = outcomes.count("unreadable")
    counts = {
        "tests": str(len(outcomes)),
        "failures": str(len(outcomes) - errors - outcomes.count("proved")),
        "errors": str(errors),
    }
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": NAME, **counts, "skipped": "0", "time": "0"})
    for verdict in report.skills:
        names = {"classname": NAME.replace(" ", "."), "name": printable(verdict.skill), "time": "0"}
        case = ElementTree.SubElement(suite, "testcase", names)
        if verdict.outcome != "proved":
            kind = "error" if verdict.outcome == "unreadable" else "failure"
            text = printable(reason(verdict))
            ElementTree.SubElement(case, kind, {"type": verdict.outcome, "message": text}).text = text
        proof = () if verdict.certificate is None else verdict.certificate.proof
        said = "\n".join([identity(verdict), *proof])
        ElementTree.SubElement(case, "system-out").text = said
    ElementTree.indent(root)
    return f"<?xml version='1.0' encoding='utf-8'?>\n{ElementTree.tostring(root, encoding='unicode')}\n"


def sarif(report: VerifyReport) -> str:
    """Return a SARIF 2.1.0 log with one result per skill, proved ones among them.

    References:
        OASIS, Static Analysis Results Interchange Format (SARIF) Version 2.1.0 (2020).
    """
    rules = [
        {"id": identifier, "name": name.title().replace(" ", ""), "shortDescription": {"text": text}}
        for name, (identifier, text, _) in RULES.items()
    ]
    driver = {"name": NAME, "version": skillctl.__version__, "rules": rules}
    log = {
        "$schema": SARIF_SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {"driver": driver},
                "invocations": [{"executionSuccessful": True}],
                "results": [_sarif_result(verdict) for verdict in report.skills],
            }
        ],
    }
    return f"{json.dumps(log, ensure_ascii=False, indent=2)}\n"


def _sarif_result(verdict: SkillVerdict) -> dict[str, Any]:
    identifier, _, level = RULES[verdict.outcome]
    uri = quote(Path(_location(verdict)).as_posix())
    if Path(_location(verdict)).is_absolute():
        uri = f"file://{uri}"
    result: dict[str, Any] = {
        "ruleId": identifier,
        "ruleIndex": list(RULES).index(verdict.outcome),
        "kind": "pass" if verdict.outcome == "proved" else "fail",
        "level": level,
        "message": {"text": printable(f"{verdict.skill}: {reason(verdict)}")},
        "locations": [{"physicalLocation": {"artifactLocation": {"uri": uri}}}],
        "properties": {"skill": printable(verdict.skill), "digest": verdict.digest},
    }
    if verdict.digest is not None:  # the same content gives the same alert, wherever the file lies
        result["partialFingerprints"] = {"skillContent/v1": verdict.digest}
    return result


def reason(verdict: SkillVerdict) -> str:
    """Return why a skill has its outcome, in sentences."""
    certificate = verdict.certificate
    if certificate is None:
        return describe(verdict.error).message if verdict.error else verdict.outcome
    if verdict.outcome == "proved":
        return " ".join(certificate.proof)
    return " ".join([*verdict.unmet, *certificate.failures, *certificate.evidence])


def identity(verdict: SkillVerdict) -> str:
    """Return the digest that a verdict holds for."""
    return verdict.digest or "no digest: the file is not intact"


def _location(verdict: SkillVerdict) -> str:
    path = Path(verdict.skill) if verdict.path is None else verdict.path
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _data(text: str) -> str:
    """Escape the message of a workflow command."""
    return printable(text).replace("%", "%25")


def _property(text: str) -> str:
    """Escape a property of a workflow command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def _json(report: VerifyReport) -> str:
    return f"{render.to_json(report)}\n"


WRITERS: dict[str, Callable[[VerifyReport], str]] = {"junit": junit, "json": _json, "sarif": sarif}
