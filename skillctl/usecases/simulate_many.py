"""Many episodes of a skill on a simulated arm: how often it succeeds, and why it fails."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from skillctl.errors import UsageError
from skillctl.progress import Progress
from skillctl.simulation.batch import BatchOutcome, Row, run_batch
from skillctl.simulation.bullet import load_bullet
from skillctl.simulation.draws import batch_of
from skillctl.simulation.prepare import arm_of
from skillctl.simulation.scenario import Sampling, Scenario
from skillctl.simulation.tally import (
    CONFIDENCE,
    LostCups,
    encode_rows,
    failures,
    lost_cups,
    medians,
    wilson_interval,
)
from skillctl.store import Lock, write_file
from skillctl.store.source import Source, open_skill
from skillctl.usecases.simulate import adapting, proof_notes, require_directories
from skillctl.workers import Workers


@dataclass(frozen=True)
class PartTally:
    """One part of a combined skill: its name, the episodes in which it acted, and their successes."""

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
    """The result of many episodes.

    Attributes:
        skill, digest: The skill that was run.
        arm, tip, held: The arm, the link that is its hand, and its joints that do not move.
        seed: Seed of all that was drawn.
        hands: Number of episodes by orientation of the hand.
        unit: Unit of final errors and tracking: ``m``, or ``rad`` for a skill that moves joints.
        episodes, successes, success_rate: How many episodes there were, and how many succeeded.
        interval, confidence: Wilson's interval of the probability of a success.
        min_success, enough: The rate that was asked for, and whether it was met.
        failures: Number of episodes by class of failure.
        failed: Each episode that failed.
        parts: Episodes by the part of a combined skill that acted; none acts if an episode cannot begin.
        lost: What became of the cups that a chain lost.
        medians: Median of each figure over the episodes that have it, in SI units.
        simulated_seconds, wall_seconds: Simulated time of all episodes, and the time that they took.
        table, overview: Files that were written, if any.
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
    lost: LostCups
    medians: dict[str, float]
    simulated_seconds: float
    wall_seconds: float
    table: Path | None
    overview: Path | None
    notes: tuple[str, ...]
    hands: dict[str, int]
    tip: str
    held: dict[str, float]
    unit: str


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
    """Run the episodes of a scenario. The workers do not change the results.

    Args:
        reference: The skill.
        scenario: How many episodes, and what is drawn for each; by default the place of the cup on its
            board, and a start near that of a demonstration.
        workers: Processes, or a cluster; by default one process.
        min_success: Share of successes that is enough.
        table: File for one row per episode, CSV.
        overview: File for one picture of all episodes, PNG.
        colour_by: What the colours of the overview show; by default ``outcome``, but ``part`` if the parts
            of a combined skill end at different places.
        store: The store of names; default as on the command line.
        lock: Allow only skills that it names.
        progress: Called with (successes and rate in words, episodes done, episodes in all).

    Raises:
        NotFoundError: No such skill, or PyBullet is not installed.
        UsageError: A share outside 0 to 1, or a scenario that does not fit this skill.
        GoalNotReachedError: No episode could begin, so an overview would be empty.
    """
    if not 0 <= min_success <= 1:
        raise UsageError(f"min-success: a must be a share from 0 to 1, as in 0.9; got {min_success:g}.")
    source = open_skill(reference, store, lock)
    require_directories(table, overview)
    load_bullet()  # before any process is started, so that the user learns at once that it is missing
    began = time.perf_counter()
    batch, starts = batch_of(source.skill, source.artifact.demonstrations, scenario)
    adapt = adapting(batch, source.skill)
    rows = run_batch(source.skill, batch, starts, adapt=adapt, workers=workers, progress=progress)
    report = _report(source, batch, rows, min_success, time.perf_counter() - began, table, overview)
    if table is not None:
        write_file(table, encode_rows(rows))
    if overview is not None:
        write_file(overview, _encode_overview(source, rows, report, colour_by))
    return report


def _encode_overview(
    source: Source,
    rows: tuple[Row, ...],
    report: SimulateManyReport,
    colour_by: Literal["outcome", "part"] | None,
) -> bytes:
    from skillctl.simulation.picture import encode_overview  # late: only pictures need Pillow

    low, high = report.interval
    ends = source.skill.attractors[:, : source.skill.space.positions]
    return encode_overview(
        rows,
        title=source.name,
        verdict=f"{report.successes} of {report.episodes} succeeded; "
        f"{report.confidence:.0%} interval {low:.0%} to {high:.0%}",
        colour_by=colour_by or ("part" if (ends != ends[0]).any() else "outcome"),
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
    model = arm_of(scenario)
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
        lost=lost_cups(rows),
        medians=medians(rows),
        simulated_seconds=sum(row.metrics.simulated_time for row in rows if row.metrics is not None),
        wall_seconds=wall_seconds,
        table=table,
        overview=overview,
        notes=(
            *model.notes,
            *_avoided(rows),
            *proof_notes(source, scenario.control),
            *_sameness(scenario),
        ),
        hands=dict(Counter(row.trace.hand for row in rows if row.trace is not None).most_common()),
        tip=model.tip_link,
        held=dict(model.held),
        unit=source.skill.space.unit,
    )


def _avoided(rows: tuple[Row, ...]) -> tuple[str, ...]:
    """Return what of the scene the hand kept out of, for each way in which episodes differ in that."""
    counts = Counter(row.trace.avoided for row in rows if row.trace is not None and row.trace.avoided)
    if len(counts) == 1:
        return tuple(counts)
    return tuple(f"in {count} episodes {said}" for said, count in counts.most_common())


def _sameness(scenario: Scenario) -> tuple[str, ...]:
    if scenario.sampling == Sampling() and not (scenario.noise or scenario.target_error):
        return (
            "nothing differs between the episodes: the start and all else are given, and nothing is drawn.",
        )
    return ()


def _parts(source: Source, rows: tuple[Row, ...]) -> tuple[PartTally, ...]:
    tallies = []
    for number, name in enumerate(_part_names(source)):
        acted = [row.success for row in rows if row.trace is not None and row.trace.part == number]
        tallies.append(PartTally(name, len(acted), sum(acted)))
    return tuple(tallies)


def _part_names(source: Source) -> tuple[str, ...]:
    """Return the names of the parts of a combined skill, none for any other; those of a chain act in turn."""
    count, parents = len(source.skill.acting_parts), source.artifact.provenance.parents
    if count == 1 or source.skill.kind == "chain":
        return ()
    if len(parents) != count:  # a combined skill among the parents was taken apart
        return tuple(f"part {number}" for number in range(1, count + 1))
    return tuple(parent.name for parent in parents)
