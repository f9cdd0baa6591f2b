"""A skill on a simulated arm, many times: how often it works, and why it does not."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from skillctl.errors import UsageError
from skillctl.progress import Progress
from skillctl.simulation.batch import BatchOutcome, Row, run_batch
from skillctl.simulation.bullet import load_bullet
from skillctl.simulation.draws import batch_of
from skillctl.simulation.scenario import Sampling, Scenario
from skillctl.simulation.tally import CONFIDENCE, encode_rows, failures, medians, wilson_interval
from skillctl.store import Lock, write_file
from skillctl.store.source import Source, open_skill
from skillctl.usecases.simulate import proof_notes, require_directories
from skillctl.workers import Workers


@dataclass(frozen=True)
class PartTally:
    """How one part of a combined skill did: its name, in how many episodes it acted, and successes."""

    name: str
    episodes: int
    successes: int


@dataclass(frozen=True)
class FailedEpisode:
    """One episode that failed: its number, its class, and what happened."""

    episode: int
    outcome: BatchOutcome
    detail: str


@dataclass(frozen=True)
class SimulateManyReport:
    """What happened in many episodes.

    Attributes:
        skill, digest: What was run.
        arm, seed: On which arm, and from which seed everything was drawn.
        episodes, successes, success_rate: How many, and how many reached their target or grasped their cup.
        interval, confidence: Wilson's interval of the probability of a success.
        min_success, enough: The rate that was asked for, and whether it was met.
        failures: Number of episodes by class of failure.
        failed: Each of them.
        parts: For a combined skill, by the part that acted; episodes that could not begin have none.
        medians: Of each figure over the episodes that have it, in SI units.
        simulated_seconds, wall_seconds: All episodes together, and what they cost.
        table, overview: Files written, if any.
        notes: What the figures do not show.
    """

    skill: str
    digest: str
    arm: str
    seed: int
    episodes: int
    successes: int
    success_rate: float
    interval: tuple[float, float]
    confidence: float
    min_success: float
    enough: bool
    failures: dict[str, int]
    failed: tuple[FailedEpisode, ...]
    parts: tuple[PartTally, ...]
    medians: dict[str, float]
    simulated_seconds: float
    wall_seconds: float
    table: Path | None
    overview: Path | None
    notes: tuple[str, ...]


def simulate_many(
    reference: str | Path,
    scenario: Scenario,
    *,
    workers: Workers | None = None,
    min_success: float = 1.0,
    table: Path | None = None,
    overview: Path | None = None,
    colour_by: Literal["outcome", "part"] | None = None,
    store: Path | None = None,
    lock: Lock | None = None,
    progress: Progress | None = None,
) -> SimulateManyReport:
    """Run the episodes of a scenario. The workers that run them do not change them.

    Args:
        reference: The skill.
        scenario: How many episodes, and what differs between them. If it does not say what: the place of
            the cup on its board, and the starts of the skill's demonstrations, scattered.
        workers: Processes, or a cluster; by default one process.
        min_success: Share of successes that is enough.
        table: Write one row per episode there, as CSV.
        overview: Write all of them in one picture there, as PNG.
        colour_by: Of the overview; by default ``outcome``, but ``part`` if the parts of a combined skill end
            at different places.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        progress: Called with (successes and rate in words, episodes done, episodes in all).

    Raises:
        NotFoundError: No such skill, or PyBullet is not installed.
        UsageError: A share outside 0 to 1, or what makes no sense for this skill.
        GoalNotReachedError: There is nothing to see in an overview.
    """
    if not 0 <= min_success <= 1:
        raise UsageError(f"min-success: a share from 0 to 1, as in 0.9; got {min_success:g}.")
    source = open_skill(reference, store, lock)
    require_directories(table, overview)
    load_bullet()  # if it is missing, that is said before any process is started
    began = time.perf_counter()
    batch, starts = batch_of(source.skill, source.artifact.demonstrations, scenario)
    report_of = None if progress is None else partial(_report_progress, progress, began)
    rows = run_batch(source.skill, batch, starts, workers=workers, progress=report_of)
    report = _report(source, batch, rows, min_success, time.perf_counter() - began, table, overview)
    if table is not None:
        write_file(table, encode_rows(rows))
    if overview is not None:
        write_file(overview, _encode_overview(source, rows, report, colour_by))
    return report


def _report_progress(progress: Progress, began: float, done: int, total: int, successes: int) -> None:
    if not done:
        progress("starting", done, total)
        return
    rate = done / max(time.perf_counter() - began, 1e-9)
    progress(f"{successes} of {done} succeeded, {rate:.1f} episodes/s", done, total)


def _encode_overview(
    source: Source,
    rows: tuple[Row, ...],
    report: SimulateManyReport,
    colour_by: Literal["outcome", "part"] | None,
) -> bytes:
    from skillctl.simulation.picture import encode_overview  # late: only pictures need Pillow

    low, high = report.interval
    return encode_overview(
        rows,
        title=source.name,
        verdict=f"{report.successes} of {report.episodes} succeeded; "
        f"{report.confidence:.0%} interval {low:.0%} to {high:.0%}",
        colour_by=colour_by or ("part" if len(source.skill.attractors) > 1 else "outcome"),
        parts=_part_names(source),
    )


def _report(
    source: Source,
    scenario: Scenario,
    rows: tuple[Row, ...],
    min_success: float,
    wall_seconds: float,
    table: Path | None,
    overview: Path | None,
) -> SimulateManyReport:
    count, successes = len(rows), sum(row.success for row in rows)
    return SimulateManyReport(
        skill=source.name,
        digest=source.artifact.digest,
        arm=scenario.arm,
        seed=scenario.seed,
        episodes=count,
        successes=successes,
        success_rate=successes / count,
        interval=wilson_interval(successes, count),
        confidence=CONFIDENCE,
        min_success=min_success,
        enough=successes >= min_success * count,
        failures={str(kind): number for kind, number in failures(rows).items()},
        failed=tuple(FailedEpisode(row.index, row.outcome, row.detail) for row in rows if not row.success),
        parts=_parts(source, rows),
        medians=medians(rows),
        simulated_seconds=sum(row.metrics.simulated_time for row in rows if row.metrics is not None),
        wall_seconds=wall_seconds,
        table=table,
        overview=overview,
        notes=(*proof_notes(source, scenario.control), *_sameness(scenario)),
    )


def _sameness(scenario: Scenario) -> tuple[str, ...]:
    if scenario.sampling == Sampling() and not (scenario.noise or scenario.target_error):
        return (
            "nothing differs between the episodes: the start and all else are given, and nothing is drawn.",
        )
    return ()


def _parts(source: Source, rows: tuple[Row, ...]) -> tuple[PartTally, ...]:
    acted = [(row.trace.part, row.success) for row in rows if row.trace is not None]
    return tuple(
        PartTally(
            name,
            sum(part == number for part, _ in acted),
            sum(part == number and success for part, success in acted),
        )
        for number, name in enumerate(_part_names(source))
    )


def _part_names(source: Source) -> tuple[str, ...]:
    """Return the names of the parts of a combined skill, none for any other."""
    count, parents = len(source.skill.acting_parts), source.artifact.provenance.parents
    if count == 1:
        return ()
    if len(parents) != count:  # a combined skill among the parents was taken apart
        return tuple(f"part {number}" for number in range(1, count + 1))
    return tuple(parent.name for parent in parents)
