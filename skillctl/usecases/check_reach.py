"""Whether an arm can reach the start, the path and the target of a skill; nothing is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.simulation.check import Reachability, check
from skillctl.simulation.draws import chosen
from skillctl.simulation.scenario import Scenario
from skillctl.store import Lock
from skillctl.store.source import open_skill
from skillctl.usecases.simulate import adapted_to


@dataclass(frozen=True)
class CheckReachReport:
    """The result of a check of reach.

    Attributes:
        skill, digest: The skill that was checked.
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
    """Return whether an arm can reach the start, the path and the target of a skill.

    Args:
        reference: The skill.
        scenario: Arm, placement, start, target, limits.
        demo: Number, from 0, of the embedded demonstration whose start is used.
        episode: Number, from 0, of the one episode to check of those that the scenario draws.
        store: The store of names; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        NotFoundError: No such skill, or PyBullet is not installed.
        UsageError: A start, target or placement that does not fit this skill.
    """
    source = open_skill(reference, store, lock)
    taught = source.artifact.demonstrations
    scenario = chosen(source.skill, taught, scenario or Scenario(), demo=demo, episode=episode)
    skill, _ = adapted_to(scenario, source.skill)
    return CheckReachReport(source.name, source.artifact.digest, check(skill, scenario))
