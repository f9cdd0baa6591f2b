"""Whether an arm can hold its hand where a skill wants it, without running anything."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.simulation.check import Reachability, check
from skillctl.simulation.draws import chosen
from skillctl.simulation.scenario import Scenario
from skillctl.store import Lock
from skillctl.store.source import open_skill


@dataclass(frozen=True)
class CheckReachReport:
    """What the arm can reach.

    Attributes:
        skill, digest: What was looked at.
        reachability: Start, path and target, and how much room there is.
    """

    skill: str
    digest: str
    reachability: Reachability


def check_reach(
    reference: str | Path,
    scenario: Scenario | None = None,
    *,
    demo: int | None = None,
    episode: int | None = None,
    store: Path | None = None,
    lock: Lock | None = None,
) -> CheckReachReport:
    """Say whether an arm can reach the start, the path and the target of a skill.

    Args:
        reference: The skill.
        scenario: Arm, placement, start, target, limits.
        demo: Start where this embedded demonstration starts, counted from 0.
        episode: Look at this one of the episodes that the scenario draws, counted from 0.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        NotFoundError: No such skill, or PyBullet is not installed.
        UsageError: A start, target or placement that makes no sense for this skill.
    """
    source = open_skill(reference, store, lock)
    taught = source.artifact.demonstrations
    scenario = chosen(source.skill, taught, scenario or Scenario(), demo=demo, episode=episode)
    return CheckReachReport(source.name, source.artifact.digest, check(source.skill, scenario))
