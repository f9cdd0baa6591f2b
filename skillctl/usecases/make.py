"""How every command makes a skill: it looks for it, builds it if need be, proves it, and writes it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from skillctl.compose.parts import notes_on
from skillctl.demonstrations.formats import digest_of
from skillctl.errors import FitError, InputDataError
from skillctl.evaluate.errors import report_errors
from skillctl.model.golden import golden_motions
from skillctl.model.skill import Skill
from skillctl.plotting.formats import require_picture
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import (
    Artifact,
    DemonstrationReport,
    InputRecord,
    Operation,
    ParentRecord,
    current_provenance,
    input_fingerprint,
)
from skillctl.store.source import Source, carried_demonstrations
from skillctl.store.ties import is_complete
from skillctl.usecases.destination import Destination, Written

# The option that records, in one digest, the skills to choose from.
CANDIDATES = "candidates"
CHECK_PARTS = "`skillctl verify-stability SKILL…` says which skill is not proved; learn that one again."
Details = TypeVar("Details")
ASKED_FOR = ("it was asked for",)
PART = "part {}".format  # the role of a parent, by its number from 1


@dataclass(frozen=True, kw_only=True)
class MakeReport:
    """What a command that makes a skill did.

    Attributes:
        status: ``learned``, ``merged``, ``combined`` or ``chained``; or ``up to date``: the same inputs and
            options gave what is there, and nothing was computed again.
        written: How to name the skill, where it is, what it is.
        certificate: What is proved of it, derived now.
        notes: Sentences for the user.
        warnings: Sentences on what is wrong with what it was made from; they are kept with it.
        reasons: Why it was made, in words; empty if it was up to date.
    """

    status: str
    written: Written
    certificate: Certificate
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()

    @property
    def not_guaranteed(self) -> tuple[str, ...]:
        """What is not proved, in sentences; empty if everything is."""
        return (*self.certificate.failures, *self.certificate.evidence)


@dataclass(frozen=True)
class Request:
    """What every command that makes a skill is asked for.

    Attributes:
        destination: Where the skill goes.
        force: Make it even if the same inputs and options gave what is there.
        plot: Draw it there.
    """

    destination: Destination
    force: bool = False
    plot: Path | None = None

    def __post_init__(self) -> None:
        if self.plot is not None:
            require_picture(self.plot)


@dataclass(frozen=True, eq=False)
class Made(Generic[Details]):
    """The result of a request, before it is written.

    Attributes:
        artifact: The skill with everything that is kept with it.
        certificate: What is proved of it.
        details: More for the report; None if the skill was there already.
        reasons: Why it was built, in words.
        current: Where it is already; None if it has to be written.
    """

    artifact: Artifact
    certificate: Certificate
    details: Details | None
    reasons: tuple[str, ...] = ()
    current: Written | None = None

    def write(self, destination: Destination, status: str) -> dict[str, Any]:
        """Write it unless it is there already, and return the fields of a `MakeReport`, but for its notes.

        Args:
            destination: Where the skill goes.
            status: The status to report if it was built.

        Raises:
            StoreError: It cannot be written.
        """
        written = self.current or destination.write(self.artifact)
        return {
            "status": "up to date" if self.current else status,
            "written": written,
            "certificate": replace(self.certificate, digest=written.digest),
            "warnings": self.artifact.operation.results.get("warnings", ()),
            "reasons": self.reasons,
        }


def make(
    request: Request,
    operation: Operation,
    build: Callable[[], tuple[Artifact, Certificate, Details]],
    *,
    inputs: Sequence[Path] = (),
    parents: Sequence[ParentRecord] | None = (),
    fits: Callable[[Artifact], bool] = lambda _: True,
) -> Made[Details]:
    """Return what is at the destination, or what is to be written there; nothing is written here.

    Args:
        request: Where it goes.
        operation: What decides the result.
        build: Computes the artifact, the certificate and the details; called only if need be.
        inputs: Files that the skill is made from.
        parents: Skills that it is made from; None if the operation says which they are.
        fits: Whether the skill that is there can be the result, whatever its file states.

    Raises:
        UsageError, StoreError: The destination cannot be used.
    """
    current = request.destination.current()
    there = current[0] if current else None
    reasons = reasons_to_make(there, operation, inputs, request.destination.note, parents)
    if there is not None and not reasons and not fits(there):
        reasons = ("what is there is not what its file says it was made from",)
    if current is not None and not reasons and not request.force:
        artifact, written = current
        return Made(artifact, certify(artifact.skill), None, current=written)
    return Made(*build(), reasons or ASKED_FOR)


def require_stable(certificate: Certificate, hint: str = CHECK_PARTS) -> Certificate:
    """Return the certificate if it says ``stable``, else raise FitError: nothing unproved is written."""
    if certificate.verdict != "stable":
        reason = certificate.failures[0] if certificate.failures else "no proof was found."
        raise FitError(f"the skill could not be proved stable, so nothing was written: {reason}", hint=hint)
    return certificate


@dataclass(frozen=True)
class PartSummary:
    """One skill that went into another.

    Attributes:
        skill, digest: How it was named and its content digest.
        share: Its weight (merge) or prior (combine); all sum to one.
        n_components: Of all its leaves together.
    """

    skill: str
    digest: str
    share: float
    n_components: int


def parents_of(sources: Sequence[Source], role: Callable[[int], str] = PART) -> list[ParentRecord]:
    """Return what a child records about its parents; ``role`` names them by their numbers from 1."""
    return [source.as_parent(role(number)) for number, source in enumerate(sources, start=1)]


def child_artifact(
    child: Skill,
    sources: Sequence[Source],
    operation: Operation,
    reports: Sequence[DemonstrationReport],
    inputs: Sequence[InputRecord] = (),
    *,
    turn: bool = False,
    role: Callable[[int], str] = PART,
) -> Artifact:
    """Return the artifact of a skill made from others.

    The demonstrations of each leaf are kept, moved as the leaf was moved.

    Args:
        child: Its leaves are those of the parents, in the same order.
        sources: The parents.
        operation: What made it.
        reports: On the demonstrations.
        inputs: Files that were read besides the parents.
        turn: Whether motions of poses turned with their targets.
        role: Names the parents by their numbers from 1.
    """
    demonstrations = carried_demonstrations(sources, child.leaves, turn=turn)
    provenance = current_provenance(inputs=inputs, parents=parents_of(sources, role))
    return Artifact(child, demonstrations, operation, provenance, tuple(reports), golden_motions(child))


def reports_on(artifact: Artifact) -> tuple[DemonstrationReport, ...]:
    """Return reports on how the leaves of an artifact repeat their demonstrations now."""
    pairs = zip(artifact.skill.leaves, artifact.demonstrations, strict=True)
    return tuple(
        report
        for number, (leaf, motions) in enumerate(pairs)
        if motions is not None
        for report in report_errors(leaf, motions, number)
    )


def write_child(
    request: Request,
    made: Made[Details],
    status: str,
    sources: Sequence[Source],
    shares: Sequence[float],
    notes: Sequence[str],
) -> dict[str, Any]:
    """Write a skill made from others, unless it is there already, and draw it beside its parents.

    Args:
        request: Where it goes.
        made: The skill.
        status: The status to report if it was built.
        sources: Its parents.
        shares: The weight or prior of each.
        notes: For the report, besides those on the parents.

    Returns:
        The fields of a `MakeReport`, and ``parts``, one `PartSummary` per parent.

    Raises:
        StoreError: It cannot be written.
    """
    fields = made.write(request.destination, status)
    if request.plot is not None:
        from skillctl.usecases.pictures import picture_family  # late: only pictures need Matplotlib

        picture_family(fields["written"].skill, made.artifact, sources, shares, request.plot)
    parts = tuple(
        PartSummary(source.name, source.artifact.digest, share, source.skill.n_components)
        for source, share in zip(sources, shares, strict=True)
    )
    return {**fields, "notes": (*notes_on([source.skill for source in sources]), *notes), "parts": parts}


def reasons_to_make(
    current: Artifact | None,
    operation: Operation,
    paths: Sequence[Path],
    note: str | None,
    parents: Sequence[ParentRecord] | None = (),
) -> tuple[str, ...]:
    """Return, in words, why an artifact is not the result of an operation on these inputs; empty if it is.

    Args:
        current: The artifact that is there, if any.
        operation: The operation.
        paths: Its input files.
        note: The note to keep.
        parents: The skills it works on; None if the operation says which they are.
    """
    if current is None:
        return ("there is no readable skill yet",)
    if not is_complete(current.operation):
        return ("it does not say what came of it",)
    there = current.provenance
    found = [_sha256(path) for path in paths]
    reasons = []
    if len(found) != len(there.inputs):
        reasons.append(f"it was made from {len(there.inputs)} files, not {len(found)}")
    else:
        changed = zip(paths, found, there.inputs, strict=True)
        reasons += [f"{path} has changed" for path, sha256, record in changed if sha256 != record.sha256]
    if parents is not None:
        reasons += _changed_parents(there.parents, parents)
    reasons += _changed_options(current.operation, operation)
    if note not in (None, current.operation.note):
        reasons.append("the note is another one")
    would_be = current_provenance(inputs=there.inputs, parents=there.parents if parents is None else parents)
    if would_be.tool != there.tool:
        reasons.append(f"it was made by skillctl {there.tool}, and this is {would_be.tool}")
    same = input_fingerprint(current.operation, there) == input_fingerprint(operation, would_be)
    return tuple(reasons) if reasons or same else ("it was made in another way",)


def _changed_parents(there: Sequence[ParentRecord], wanted: Sequence[ParentRecord]) -> list[str]:
    if len(there) != len(wanted):
        return [f"it was made from {len(there)} skills, not {len(wanted)}"]
    return [
        f"{after.role} is {_named(after)} and was {_named(before)}"
        for before, after in zip(there, wanted, strict=True)
        if before.digest != after.digest
    ]


def _named(parent: ParentRecord) -> str:
    return f"{parent.shown} ({parent.digest.removeprefix('sha256:')[:12]})"


def candidates_digest(digests: Iterable[str]) -> str:
    """Return one digest for the skills that there are to choose from, in this order."""
    return f"sha256:{hashlib.sha256(' '.join(digests).encode()).hexdigest()}"


def _changed_options(there: Operation, wanted: Operation) -> list[str]:
    before, after = (
        {**operation.model_dump(mode="json")["options"], "seed": operation.seed}
        for operation in (there, wanted)
    )
    names = sorted(before.keys() | after.keys())
    return [
        "the skills to choose from are others"
        if name == CANDIDATES
        else f"{name} is {_value(after.get(name))} and was {_value(before.get(name))}"
        for name in names
        if before.get(name) != after.get(name)
    ]


def _value(value: object) -> str:
    if value is None or value == []:
        return "not set"
    return ",".join(map(_value, value)) if isinstance(value, list | tuple) else str(value)


def _sha256(path: Path) -> str:
    try:
        return digest_of(path)
    except (OSError, InputDataError):
        return ""  # the reader says in words what is wrong with it
