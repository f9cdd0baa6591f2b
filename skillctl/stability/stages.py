"""The stages of a chain: where each is over, that the next is proved from there, and by when."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skillctl import rotations
from skillctl.arrays import FloatArray
from skillctl.geometry import box
from skillctl.model.chained import WAIT, ChainedSkill
from skillctl.model.coordinates.enclosure import GUARD
from skillctl.model.pose import Pose
from skillctl.model.skill import ActingSkill, Skill
from skillctl.model.space import Space
from skillctl.stability.blocks import Block, blocks_of, whole_of
from skillctl.stability.parts import least, proved_rate
from skillctl.stability.region import selectable_parts
from skillctl.stability.report import Course, PartCertificate, StageCertificate, at_least, at_most
from skillctl.stability.sublevels import MOST_COORDINATES, sublevels_of

JUMPS = {
    "stay": "the stage that acts goes on from where one leaves the state, a combined one with the part whose "
    "region that is",
    "back": "of the stages begun so far, the one goes on that was taught nearest to where one leaves the "
    "state, by the largest density",
}
TAUGHT = 2.0  # motions start within so many standard deviations of what the first stage was taught


@dataclass(frozen=True, eq=False, slots=True)
class Starts:
    """Where a stage may begin: positions in a box, and orientations within an angle of one.

    Attributes:
        low: Lowest coordinates of the position, shape (c,).
        high: Highest coordinates, shape (c,).
        turn: Of poses, the rotation vector (3,) in the middle; empty of others.
        angle: Of poses, how far from it orientations lie at most, [rad].
    """

    low: FloatArray
    high: FloatArray
    turn: FloatArray
    angle: float

    @classmethod
    def around(cls, state: FloatArray, distance: float, space: Space) -> Starts:
        """Return all states within a distance of one state (d,)."""
        position, turn = np.split(state, [space.positions])
        return cls(position - distance, position + distance, turn, distance / _length(space))

    @classmethod
    def turned_anyhow(cls, low: FloatArray, high: FloatArray, skill: Skill) -> Starts:
        """Return all positions in a box between two corners (c,); of poses in any orientation."""
        return cls(low, high, skill.attractors[0][skill.space.positions :], math.pi)

    def away(self, target: FloatArray) -> float:
        """Return how far a position is at most from that of a target (d,)."""
        position = target[: len(self.low)]
        corner = np.maximum(np.abs(self.low - position), np.abs(self.high - position))
        return (1 + GUARD) * float(np.linalg.norm(corner))

    def turned(self, target: FloatArray) -> float:
        """Return how far an orientation is turned at most from that of a target (d,), [rad]."""
        if not self.turn.size:
            return 0.0
        between = float(rotations.angles(self.turn, target[len(self.low) :]))
        return (1 + GUARD) * (between + self.angle)


def level_within(stage: Skill, distance: float) -> float | None:
    """Return c such that {V ≤ c} of each part of a stage lies within a distance of the part's target.

    Args:
        stage: A skill whose parts are proved.
        distance: In the unit of the space; of poses √(‖Δp‖² + ℓ²θ²).

    Returns:
        Nearly the largest such c in plain coordinates, a smaller one in others; None if float64 has none.
    """
    levels = []
    for part in stage.acting_parts:
        blocks = _apart(part)  # each of n blocks within distance / √n: all within the distance
        share = distance * (1 - GUARD) / math.sqrt(len(blocks))
        radius = least([sublevels_of(block).radius(share) for block in blocks])
        levels.append(None if radius is None else radius**2 * (1 - GUARD))
    return least(levels)


def over_within(part: ActingSkill, level: float) -> float:
    """Return a distance from the target of a proved part within which {V ≤ c} lies; may be infinite."""
    return (1 + GUARD) * math.hypot(*(sublevels_of(block).farthest(level) for block in _apart(part)))


def _apart(part: ActingSkill) -> tuple[Block, ...]:
    """Return all coordinates together where they are plain, which is exact, else block by block."""
    return blocks_of(part) if part.coordinates.links else (whole_of(part),)


def begun_stages(chain: ChainedSkill, first: Starts) -> Iterator[tuple[dict[int, list[Starts]], float]]:
    """Yield, stage by stage, where each part that may act begins, and how near to a target it is over then.

    Args:
        chain: With parts that are proved where they begin.
        first: Where the first stage begins.
    """
    starts = [first]
    for skill, parts, level in zip(chain.parts, chain.stages, chain.levels.tolist(), strict=True):
        begun: dict[int, list[Starts]] = {}
        for start in starts:
            for index in selectable_parts(skill, start.low, start.high):
                begun.setdefault(parts[index], []).append(start)
        ends = [(chain.acting_parts[index], over_within(chain.acting_parts[index], level)) for index in begun]
        yield begun, max(distance for _, distance in ends)
        starts = [Starts.around(part.attractor, distance, part.space) for part, distance in ends]


def follow_stages(
    chain: ChainedSkill, proved: Sequence[PartCertificate], period: float, first: Starts | None = None
) -> tuple[Course | None, tuple[str, ...]]:
    r"""Return by when each stage is over, and why one may not lead into the next, in sentences.

    Where a stage begins V is at most V₀, and √V shrinks as e^(−rt) or faster, so that V is at the level c
    after (1/r) ln √(V₀ / c). The state is in {V ≤ c} then, which lies in a ball around the target, and while
    events take place it stays there. The next stage begins in that ball, which bounds its own V₀.

    Args:
        chain: With parts that are proved, at least from within their radius.
        proved: What is proved of each acting part.
        period: Of the controller, [s].
        first: Where the first stage begins; by default where it was taught.

    References:
        Theory page, chains; ours.
    """
    first = _taught(chain, proved[0]) if first is None else first
    stages: list[StageCertificate] = []
    for number, (begun, within) in enumerate(begun_stages(chain, first), start=1):
        reasons = [
            _outside(chain.acting_parts[index], proved[index], start, first=number == 1)
            for index in begun
            for start in begun[index]
        ]
        if not math.isfinite(within):
            reasons.append("how far from its target it is over is beyond float64.")
        if outside := dict.fromkeys(reason for reason in reasons if reason is not None):
            return None, tuple(f"stage {number}: {reason}" for reason in outside)
        stages.append(_stage(chain, number, begun, within, proved, period))
    return _course(chain, first, stages, period), ()


def _taught(chain: ChainedSkill, proved: PartCertificate) -> Starts:
    """Return the positions that the first stage was taught, turned anyhow; of a local proof, within it."""
    part, density = chain.acting_parts[0], chain.parts[0].density
    if proved.radius is not None:
        return Starts.around(part.attractor, proved.radius / math.sqrt(part.dimension), part.space)
    reach = TAUGHT * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    low, high = box(np.vstack([density.means - reach, density.means + reach]))
    c = part.space.positions
    return Starts.turned_anyhow(low[:c], high[:c], chain)


def _outside(part: ActingSkill, proved: PartCertificate, starts: Starts, *, first: bool) -> str | None:
    """Return why nothing is proved of a part from where it may begin; None if it is."""
    unit, turned = part.space.unit, starts.turned(part.attractor)
    if proved.radius is not None:
        away = math.hypot(starts.away(part.attractor), _length(part.space) * turned)
        if away > proved.radius:
            return (
                f"it may begin up to {at_most(away)} {unit} from its target, and is proved only from within "
                f"{proved.radius:.3g} {unit}."
            )
    elif turned >= math.pi * (1 - GUARD) and not first:
        between = math.degrees(turned - starts.angle)
        return (
            f"its target is turned by {between:.4g}° from that of the stage before, which is over within "
            f"{math.degrees(starts.angle):.3g}° of its own; nothing is proved from 180° away."
        )
    return None


def _stage(
    chain: ChainedSkill,
    number: int,
    begun: Mapping[int, Sequence[Starts]],
    within: float,
    proved: Sequence[PartCertificate],
    period: float,
) -> StageCertificate:
    """Return the bounds of a stage whose parts begin in some sets of states."""
    level = float(chain.levels[number - 1])
    highest = arrival = stepped = 0.0
    for index, starts in begun.items():
        part = chain.acting_parts[index]
        value = max(_highest(part, proved[index], each) for each in starts)
        fall = max(0.5 * math.log(value / level), 0.0) * (1 + GUARD) if value > 0 else 0.0
        highest = max(highest, value)
        arrival = max(arrival, fall / (proved[index].rate or 0.0))
        stepped = max(stepped, fall / rate if (rate := proved_rate(part, 1.0, period)) else math.inf)
    return StageCertificate(
        stage=number,
        parts=tuple(index + 1 for index in begun),
        level=level,
        within=within,
        highest=_finite(highest),
        arrival=_finite(arrival),
        steps=math.ceil((1 + GUARD) * stepped / period) if math.isfinite(stepped) else None,
        waits=chain.waits(number - 1),
    )


def _highest(part: ActingSkill, proved: PartCertificate, starts: Starts) -> float:
    """Return a V that is nowhere exceeded where a part may begin; may be infinite."""
    turned = _length(part.space) * starts.turned(part.attractor)
    if proved.radius is not None:
        largest = float(np.linalg.norm(part.lyapunov)) * (1 + GUARD)  # at least the largest eigenvalue
        return largest * (starts.away(part.attractor) ** 2 + turned**2)
    if len(starts.low) > MOST_COORDINATES:
        return math.inf
    position, *orientation = blocks_of(part)
    value = sublevels_of(position).level(starts.low, starts.high)
    return (1 + GUARD) * (value + sum(float(block.lyapunov[0, 0]) * turned**2 for block in orientation))


def _course(chain: ChainedSkill, first: Starts, stages: Sequence[StageCertificate], period: float) -> Course:
    """Return the bounds of all stages and their events together."""
    arrivals = [stage.arrival for stage in stages if stage.arrival is not None]
    steps = [stage.steps for stage in stages if stage.steps is not None]
    events = [event for events in chain.events for event in events]
    seconds = [float(event.removeprefix(WAIT)) if event.startswith(WAIT) else 0.0 for event in events]
    due = sum(max(1, math.ceil(each / period)) for each in seconds)
    return Course(
        low=tuple(first.low.tolist()),
        high=tuple(first.high.tolist()),
        period=period,
        stages=tuple(stages),
        arrival=sum(arrivals) + sum(seconds) if len(arrivals) == len(stages) else None,
        steps=sum(steps) + due if len(steps) == len(stages) else None,
    )


def _length(space: Space) -> float:
    """Return how many metres count as much as a radian; of no meaning where nothing turns."""
    return space.length if isinstance(space, Pose) else 1.0


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def told(chain: ChainedSkill, course: Course, everywhere: str, *, local: bool) -> list[str]:
    """Say what is proved of a chain, stage by stage; ``everywhere`` is from where."""
    unit, names = chain.space.unit, chain.space.names
    ranges = zip(names, course.low, course.high, strict=False)  # a pose has names of its turn, too
    taught = ", ".join(f"{name} from {at_most(low)} to {at_least(high)}" for name, low, high in ranges)
    ends = "the attractor" if len(chain.attractors) == 1 else "an attractor"
    near = ", each of which leaves the state within the radius of the part that goes on" if local else ""
    sentences = [
        "Every motion ends its stages one after the other, each in finite time, and converges exponentially "
        f"to {ends} of the last, from {everywhere}: a stage is over once V of the part that acts has fallen "
        "to its level, and wherever that may be, the next stage is proved from there.",
        f"So does every motion with finitely many disturbances{near}: {JUMPS[chain.on_jump]}.",
    ]
    place = f"motions that start in {taught} {unit}"
    for stage in course.stages:
        when = _by(stage.arrival, stage.steps, course.period)
        where = f"within {at_most(stage.within)} {unit} of its target"
        sentences.append(f"Stage {stage.stage} is over {where}{when}, of {place}.")
        place = f"motions that begin where stage {stage.stage} is over"
    if course.arrival is not None:
        when = _by(course.arrival, course.steps, course.period)
        sentences.append(
            f"With all waits, the chain is done{when}, unless a speed cap slows it; an event that is no wait "
            "counts as one step, and takes as long as its doer needs."
        )
    return sentences


def _by(time: float | None, steps: int | None, period: float) -> str:
    """Say by when something is over: in continuous time, and in steps."""
    counted = "" if steps is None else f", or {steps} steps of {at_most(period)} s"
    return "" if time is None else f" after at most {at_most(time)} s{counted}"
