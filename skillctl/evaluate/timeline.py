"""The stages of a chain in their order: where each ends, what happens then, how long it takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.evaluate.coverage import demonstrated_starts
from skillctl.evaluate.place import STEPS, period_of
from skillctl.model.chained import ChainedSkill, OnJump
from skillctl.model.rollout import rollout
from skillctl.stability.report import Certificate
from skillctl.store import Artifact


@dataclass(frozen=True)
class Stage:
    """One stage of a chain.

    Attributes:
        stage: Counted from 1.
        skill: What it was made from, as its file names it; None if it names nothing.
        attractors: Where it ends, one state for each place.
        targets: The same in the numbers in which targets are given: a pose as x, y, z, qx, qy, qz, qw.
        level: V of what acts in it, at which it is over.
        within: It is over this near to its target, proved, [unit]; None if that is not known.
        events: What happens once it is over.
        waits: How long its events wait, [s].
        begins: When it begins, with all waits but no other events: the median of the motions that were
            followed, [s]; None unless all of them came so far.
        duration: How long it takes until it is over, likewise.
        bound: By then it is over, proved, [s]; None without a bound.
    """

    stage: int
    skill: str | None
    attractors: tuple[tuple[float, ...], ...]
    targets: tuple[tuple[float, ...], ...]
    level: float
    within: float | None
    events: tuple[str, ...]
    waits: float
    begins: float | None
    duration: float | None
    bound: float | None


@dataclass(frozen=True)
class Timeline:
    """A chain as it goes on, by evaluation: durations are seen, bounds are proved.

    Attributes:
        stages: In their order.
        on_jump: What a jump changes; see ``skillctl.model.ChainedSkill``.
        disturbance_distance: A jump is longer than this, [unit].
        starts: How many motions were followed, from the starts that the first stage was taught.
        duration: All stages and waits, the median of these motions, [s]; None unless all came to the end.
    """

    stages: tuple[Stage, ...]
    on_jump: OnJump
    disturbance_distance: float
    starts: int
    duration: float | None


def timeline_of(artifact: Artifact, certificate: Certificate) -> Timeline | None:
    """Return the stages of a chain; None of other skills.

    Args:
        artifact: The skill, with what it was taught and made from.
        certificate: What is proved of it.
    """
    chain = artifact.skill
    if not isinstance(chain, ChainedSkill):
        return None
    moved = stage_ends(chain, first_starts(artifact), period_of(certificate))
    waits = np.array([chain.waits(index) for index in range(len(chain.parts))])
    ends = moved + np.cumsum(waits)  # of the events, too
    begun = np.hstack([np.zeros((len(ends), 1)), ends[:, :-1]])
    names = [parent.shown for parent in artifact.provenance.parents]
    course = certificate.course
    rows = zip_longest(
        chain.parts,
        names if len(names) == len(chain.parts) else (),
        () if course is None else course.stages,
    )
    stages = tuple(
        Stage(
            stage=index + 1,
            skill=name,
            attractors=tuple(map(tuple, skill.attractors.tolist())),
            targets=tuple(map(skill.space.given, skill.attractors)),
            level=float(chain.levels[index]),
            within=None if proved is None else proved.within,
            events=chain.events[index],
            waits=float(waits[index]),
            begins=_median(begun[:, index]),
            duration=_median((ends - waits - begun)[:, index]),
            bound=None if proved is None else proved.arrival,
        )
        for index, (skill, name, proved) in enumerate(rows)
    )
    return Timeline(
        stages=stages,
        on_jump=chain.on_jump,
        disturbance_distance=chain.disturbance_distance,
        starts=len(ends),
        duration=_median(ends[:, -1]),
    )


def first_starts(artifact: Artifact) -> FloatArray:
    """Return where motions of the first stage of a chain were taught to begin, shape (n, d).

    Without demonstrations that is every centre of its position densities.
    """
    first = artifact.skill.parts[0]
    taught = artifact.demonstrations[: len(first.leaves)]
    if any(taught):
        return demonstrated_starts(first, taught)
    return np.vstack([part.uncharted(part.density.means) for part in first.acting_parts])


def stage_ends(chain: ChainedSkill, starts: FloatArray, period: float) -> FloatArray:
    """Return when each stage is over on motions from starts (n, d), without events, [s]; NaN if it is not.

    Args:
        chain: The chain.
        starts: Shape (n, d).
        period: Of a controller, [s].

    Returns:
        Shape (n, stages).
    """
    # Once more the last stage, which begins, and has arrived at any distance, where the last one is over.
    longer = replace(
        chain,
        parts=(*chain.parts, chain.parts[-1]),
        levels=np.append(chain.levels, chain.levels[-1]),
        events=(*chain.events, ()),
    )
    motion = rollout(longer, starts, duration=STEPS * period, period=period, arrival_distance=np.inf)
    firsts = np.array([parts.start for parts in longer.stages[1:]])
    begun = motion.acting[:, :, None] >= firsts  # (n, T, stages)
    return np.where(begun.any(axis=1), motion.times[begun.argmax(axis=1)], np.nan)


def _median(times: FloatArray) -> float | None:
    """Return the median of times; None if one of them is none."""
    return float(np.median(times)) if np.isfinite(times).all() else None
