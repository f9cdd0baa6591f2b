"""What a skill does at one place: which part acts, how fast, and where the motion would end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import StateError, UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill
from skillctl.stability.report import Certificate, PartCertificate
from skillctl.store import Artifact

LONGEST_PERIOD = 0.01  # [s], of the rollout
STEPS = 20_000  # bounds the cost to a second or two


@dataclass(frozen=True)
class Region:
    """The region of influence of one part of a combined skill: the basin of its attractor, if latched.

    Attributes:
        part: Counted from 1; of a chain, over all parts of its stages.
        prior: β; the part acts where its β r is largest.
        attractor: Where it ends, a state.
        target: The same in the numbers in which a target is given: a pose as x, y, z, qx, qy, qz, qw.
        radius: Within this distance of the attractor the part provably acts alone; None if none was found, or
            if none is needed because there is a global proof.
        demonstrations: Number of embedded demonstrations.
        selected: Share of their starts that lie in it when they are left out; None of fewer than two.
    """

    part: int
    prior: float
    attractor: tuple[float, ...]
    radius: float | None
    demonstrations: int
    selected: float | None
    target: tuple[float, ...]


@dataclass(frozen=True)
class Place:
    """What a skill does at one place.

    Attributes:
        position: The place, a state.
        part: Which part acts there, counted from 1; None where all act together, and of a chain.
        stages: Of a chain, counted from 1, the stage that acts on a motion which starts there, and the one
            that goes on if a motion in its last stage jumps there; None of others.
        weights: Each part's share: of the motion (merged), or β r of it over the sum of all (combined, where
            the largest acts alone). One for a learned skill, and for the first stage of a chain.
        velocity: ξ̇ there, per second; of a pose the twist in the base frame, [m/s] and [rad/s].
        arrives: Whether the motion from there was seen to arrive.
        end: Where it was when it arrived, or when it was given up.
        attractor: Number of the attractor it arrived at, counted from 1: that of the part with this number,
            or the only one; None if it did not arrive.
        time: When it arrived, or was given up, [s].
        given, given_end: The place and the end in the numbers in which a target is given.
    """

    position: tuple[float, ...]
    part: int | None
    weights: tuple[float, ...]
    velocity: tuple[float, ...]
    arrives: bool
    end: tuple[float, ...]
    attractor: int | None
    time: float
    given: tuple[float, ...]
    given_end: tuple[float, ...]
    stages: tuple[int, int] | None = None


def regions_of(artifact: Artifact, certificate: Certificate) -> tuple[Region, ...]:
    """Return the regions of a combined skill, or of the stages of a chain that are; none for other skills."""
    skill, found = artifact.skill, list[Region]()
    proofs, taught = iter(certificate.parts), iter(artifact.demonstrations)
    for stage in skill.parts if isinstance(skill, ChainedSkill) else (skill,):
        proved = [next(proofs) for _ in stage.acting_parts]
        motions = [next(taught) for _ in stage.leaves]
        if isinstance(stage, CombinedSkill):
            found += _regions(stage, motions, proved)
    return tuple(found)


def _regions(
    skill: CombinedSkill, taught: Sequence[DemonstrationSet | None], proofs: Sequence[PartCertificate]
) -> Iterator[Region]:
    from skillctl.evaluate.coverage import selected_shares  # late: other skills need nothing of it

    rows = zip(
        skill.part_priors.tolist(),
        skill.part_attractors,
        proofs,
        selected_shares(skill, taught),
        strict=True,
    )
    for prior, attractor, proof, share in rows:
        place = tuple(attractor.tolist()), proof.radius
        yield Region(proof.part, prior, *place, *share, skill.space.given(attractor))


def at(skill: Skill, position: Sequence[float], certificate: Certificate) -> Place:
    """Return what the skill does at a position, by evaluation and one rollout: evidence, not proof.

    Args:
        skill: Any skill.
        position: Given as a target is; a hand given by its position alone is turned as at the first target.
        certificate: Of the skill.

    Raises:
        UsageError: Another number of coordinates than the skill has, or numbers that are not finite.
    """
    x, period = _state(skill, position), period_of(certificate)
    acting = skill.onward_at(x, skill.selected(x))
    motion = rollout(skill, x[None], duration=STEPS * period, period=period)
    times, path = motion.trajectory(0)
    arrives = bool(motion.arrived[0])
    goals = skill.attractors
    nearest = int(skill.space.distance(goals, path[-1]).argmin())
    return Place(
        position=tuple(x.tolist()),
        part=acting + 1 if skill.kind == "combined" else None,
        weights=tuple(skill.part_weights_at(x[None])[0].tolist()),
        velocity=tuple(skill.velocity(x, acting).tolist()),
        arrives=arrives,
        end=tuple(path[-1].tolist()),
        attractor=nearest + 1 if arrives else None,
        time=float(times[-1]),
        given=skill.space.given(x),
        given_end=skill.space.given(path[-1]),
        stages=_stages(skill, x, acting) if isinstance(skill, ChainedSkill) else None,
    )


def _stages(chain: ChainedSkill, state: FloatArray, acting: int) -> tuple[int, int]:
    """Return the stage of the part that acts, and that which goes on after a jump from the last one."""
    last = len(chain.acting_parts) - 1
    return chain.stage_of(acting) + 1, chain.stage_of(chain.resumed_at(state, last)) + 1


def period_of(certificate: Certificate) -> float:
    """Return a controller period to follow motions of a skill with, half of a proved one at most, [s]."""
    proved = [part.period for part in certificate.parts if part.period is not None]
    return min([LONGEST_PERIOD, *(0.5 * longest for longest in proved)])


def _state(skill: Skill, position: Sequence[float]) -> FloatArray:
    """Return a position as a state (d,), or raise UsageError."""
    space, first = skill.space, skill.attractors[0]
    x = np.array(position, dtype=np.float64)
    if x.shape == (space.positions,):
        x = np.concatenate([x, first[space.positions :]])
    try:
        return space.measured(x)
    except StateError:
        sizes = " or ".join(map(str, space.sizes))
        target = ",".join(f"{value:.4g}" for value in space.given(first))
        raise UsageError(
            f"at: expected {sizes} finite numbers ({', '.join(space.names)}), got {len(position)}.",
            hint=f"Separate them by commas, as in --at {target}.",
        ) from None
