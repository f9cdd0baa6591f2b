"""Many skills learned from one manifest: each proved, written and reported as ``learn`` does."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from skillctl.errors import ResourceError, SkillctlError, StoreError
from skillctl.progress import Progress
from skillctl.store import locate_store
from skillctl.usecases.learn import Learned, LearnReport, LearnRequest, finish, prepare
from skillctl.usecases.manifest import SkillEntry, read_manifest
from skillctl.usecases.target import finish_target
from skillctl.workers import WorkerDied, Workers

Outcome: TypeAlias = Literal["learned", "up to date", "failed"]


@dataclass(frozen=True)
class SkillOutcome:
    """What became of one skill of a manifest.

    Attributes:
        skill: Its name, or its file, as the manifest says it.
        outcome: Whether it was learned, was there already, or could not be learned.
        report: What ``learn`` reports of it; None if it failed.
        error: Why it failed.
    """

    skill: str
    outcome: Outcome
    report: LearnReport | None
    error: SkillctlError | None


@dataclass(frozen=True)
class LearnManyReport:
    """What became of the skills of a manifest.

    Attributes:
        manifest: The file.
        skills: In its order.
        learned, up_to_date, failed: How many of them.
    """

    manifest: Path
    skills: tuple[SkillOutcome, ...]
    learned: int
    up_to_date: int
    failed: int


def learn_many(
    manifest: str | Path,
    *,
    store: str | Path | None = None,
    force: bool = False,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> LearnManyReport:
    """Learn the skills of a manifest; those that fail do not keep others from being learned.

    Workers read and learn, and this process writes: as soon as a skill is there, in no certain order.

    Args:
        manifest: TOML file; see ``skillctl.usecases.manifest``.
        store: Where names live; default as on the command line.
        force: Learn even what is up to date.
        workers: Who reads and learns; by default this process. None of them changes a result.
        progress: Called with (skill and outcome, skills done, skills in all).

    Raises:
        NotFoundError: There is no manifest, or no such cluster.
        StoreError: The cluster was lost; what was learned before that is written.
        InputDataError: The manifest is none; nothing is learned.
    """
    entries = read_manifest(Path(manifest))
    # Found here, whatever the surroundings of workers say; files need none.
    place = locate_store(store) if any(entry.result.name for entry in entries) else None
    requests: dict[int, LearnRequest] = {}
    outcomes: dict[int, SkillOutcome] = {}
    for number, entry in enumerate(entries):
        try:
            requests[number] = entry.request(place, force)
        except SkillctlError as error:
            outcomes[number] = _failed(entry, error)
    numbers = list(requests)

    def done(position: int, made: Learned | SkillctlError | WorkerDied) -> None:
        number = numbers[position]
        outcome = outcomes[number] = _outcome(entries[number], requests[number], made)
        if progress is not None:
            progress(f"{outcome.skill} {outcome.outcome}", len(outcomes), len(entries))

    def waiting(words: str) -> None:
        if progress is not None:
            progress(words, len(outcomes), len(entries))

    waiting("starting")
    (workers or Workers()).run(_made, list(requests.values()), done=done, waiting=waiting)
    counts = Counter(each.outcome for each in outcomes.values())
    return LearnManyReport(
        manifest=Path(manifest),
        skills=tuple(outcomes[number] for number in range(len(entries))),
        learned=counts["learned"],
        up_to_date=counts["up to date"],
        failed=counts["failed"],
    )


def _made(request: LearnRequest) -> Learned | SkillctlError:
    """Learn one skill, in a worker; a failure is a result."""
    try:
        return prepare(request)
    except SkillctlError as error:
        return error
    except MemoryError:
        return ResourceError("there is not enough memory.", hint="Use fewer --jobs, or learn it by itself.")


def _outcome(
    entry: SkillEntry, request: LearnRequest, made: Learned | SkillctlError | WorkerDied
) -> SkillOutcome:
    """Write what was made, and say what became of it."""
    if isinstance(made, WorkerDied):
        made = StoreError(
            "the process that learned it died: it was killed, or there was no memory left.",
            hint="Learn it by itself, or use fewer --jobs.",
        )
    if isinstance(made, SkillctlError):
        return _failed(entry, made)
    try:
        report = finish(request, made)
        finish_target(request.destination.file, request.paths, created=report.written.created)
    except SkillctlError as error:
        return _failed(entry, error)
    return SkillOutcome(entry.called, "learned" if report.status == "learned" else "up to date", report, None)


def _failed(entry: SkillEntry, error: SkillctlError) -> SkillOutcome:
    """Return the outcome of a skill that could not be learned; its error names the skill."""
    error.args = (f"{entry.called}: {error}", *error.args[1:])
    return SkillOutcome(entry.called, "failed", None, error)
