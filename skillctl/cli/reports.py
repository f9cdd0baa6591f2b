"""Verdicts for machines that run checks: JUnit XML, SARIF, JSON, and annotations of GitHub's workflows."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import skillctl
from skillctl.cli import render, words
from skillctl.cli.errors import describe
from skillctl.errors import UsageError, printable

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

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


def read_report(text: str) -> tuple[str, Path]:
    """Return the form of a report and its file from ``junit=FILE``, or raise ValueError."""
    form, equals, path = text.partition("=")
    if form not in WRITERS or not (equals and path):
        raise ValueError(f"{text!r} is not one of {', '.join(f'{form}=FILE' for form in WRITERS)}.")
    return form, Path(path)


def require_own_files(files: Sequence[tuple[str, Path]]) -> None:
    """Raise UsageError if two reports would be written to one file."""
    paths = [os.path.realpath(path) for _, path in files]
    if len(set(paths)) < len(paths):
        raise UsageError("report: two reports have the same file.", hint="Give each report its own file.")


def write_reports(report: VerifyReport, files: Sequence[tuple[str, Path]]) -> None:
    """Write every report, each whole or not at all; raise StoreError if a file cannot be written."""
    from skillctl.store import write_file

    for form, path in files:
        write_file(path, WRITERS[form](report).encode())


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
    """Return one test case per skill: failed if not proved or open, in error if it cannot be read.

    Of a task every clause is a case of its own, with its margin; and so are golden motions.
    """
    from xml.etree import ElementTree

    cases = [case for verdict in report.skills for case in _cases(verdict)]
    kinds = [None if child is None else child.tag for child in (case.find("./*") for case in cases)]
    errors, failures = kinds.count("error"), kinds.count("failure")
    counts = {"tests": str(len(cases)), "failures": str(failures), "errors": str(errors)}
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": NAME, **counts, "skipped": "0", "time": "0"})
    suite.extend(cases)
    ElementTree.indent(root)
    return f"<?xml version='1.0' encoding='utf-8'?>\n{ElementTree.tostring(root, encoding='unicode')}\n"


def _cases(verdict: SkillVerdict) -> Iterator[Element]:
    """Yield the test case of a skill, those of the clauses of its task, and that of its golden motions."""
    said = "\n".join([identity(verdict), *_proof(verdict)])
    kind = {"proved": None, "unreadable": "error"}.get(verdict.outcome, "failure")
    yield _case(verdict.skill, said, kind, verdict.outcome, reason(verdict))
    for clause in verdict.task.clauses if verdict.task else ():
        proved = words.proved_margin(clause.bound, clause.unit)
        said = f"margin {words.margin(clause.margin, clause.unit)}, proved: {proved}"
        failed = None if clause.holds else "failure"
        yield _case(f"{verdict.skill}: {clause.clause}", said, failed, "clause", said)
    if (golden := verdict.golden) is not None:
        failed = None if golden.agrees else "failure"
        yield _case(f"{verdict.skill}: golden motions", golden.said, failed, "golden", golden.said)


def _case(name: str, said: str, kind: str | None, fault: str, why: str) -> Element:
    from xml.etree import ElementTree

    names = {"classname": NAME.replace(" ", "."), "name": printable(name), "time": "0"}
    case = ElementTree.Element("testcase", names)
    if kind is not None:
        text = printable(why)
        ElementTree.SubElement(case, kind, {"type": fault, "message": text}).text = text
    ElementTree.SubElement(case, "system-out").text = said
    return case


def sarif(report: VerifyReport) -> str:
    """Return a SARIF 2.1.0 log with one result per skill, proved ones among them.

    References:
        OASIS, Static Analysis Results Interchange Format (SARIF) Version 2.1.0 (2020).
    """
    rules = [
        {"id": identifier, "name": name.title().replace(" ", ""), "shortDescription": {"text": text}}
        for name, (identifier, text, _) in RULES.items()
    ]
    run = {
        "tool": {"driver": {"name": NAME, "version": skillctl.__version__, "rules": rules}},
        "invocations": [{"executionSuccessful": True}],
        "results": list(map(_sarif_result, report.skills)),
    }
    log = {"$schema": SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}
    return f"{json.dumps(log, ensure_ascii=False, indent=2)}\n"


def _sarif_result(verdict: SkillVerdict) -> dict[str, Any]:
    identifier, _, level = RULES[verdict.outcome]
    path = Path(_location(verdict))
    uri = f"{'file://' if path.is_absolute() else ''}{quote(path.as_posix())}"
    result: dict[str, Any] = {
        "ruleId": identifier,
        "ruleIndex": list(RULES).index(verdict.outcome),
        "kind": "pass" if verdict.outcome == "proved" else "fail",
        "level": level,
        "message": {"text": printable(f"{verdict.skill}: {reason(verdict)}")},
        "locations": [{"physicalLocation": {"artifactLocation": {"uri": uri}}}],
        "properties": {"skill": printable(verdict.skill), "digest": verdict.digest},
    }
    if verdict.digest is not None:  # the same content gives the same alert, whatever its file is called
        result["partialFingerprints"] = {"skillContent/v1": verdict.digest}
    return result


def reason(verdict: SkillVerdict) -> str:
    """Return why a skill has its outcome, in sentences."""
    certificate = verdict.certificate
    if certificate is None:
        return describe(verdict.error).message if verdict.error else verdict.outcome
    if verdict.outcome == "proved":
        return " ".join(_proof(verdict))
    return " ".join([*verdict.unmet, *certificate.failures, *certificate.evidence])


def _proof(verdict: SkillVerdict) -> tuple[str, ...]:
    """Return what is proved of a skill, and of its motions from the start box, in sentences."""
    proofs = (each.proof for each in (verdict.certificate, verdict.reach) if each is not None)
    return tuple(sentence for proof in proofs for sentence in proof)


def identity(verdict: SkillVerdict) -> str:
    """Return the digest that a verdict holds for."""
    return verdict.digest or "no digest: the file is not intact"


def _location(verdict: SkillVerdict) -> str:
    return words.near(Path(verdict.skill) if verdict.path is None else verdict.path)


def _data(text: str) -> str:
    """Escape the message of a workflow command."""
    return printable(text).replace("%", "%25")


def _property(text: str) -> str:
    """Escape a property of a workflow command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")


WRITERS: dict[str, Callable[[VerifyReport], str]] = {
    "junit": junit,
    "json": lambda report: f"{render.to_json(report)}\n",
    "sarif": sarif,
}
