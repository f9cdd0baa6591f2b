"""What a skill does at one place: which part acts, how fast, and where the motion would end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill
from skillctl.stability.report import Certificate
from skillctl.store import Artifact

LONGEST_PERIOD = 0.01  # [s], of the rollout
STEPS = 20_000  # bounds the cost to a second or two


@dataclass(frozen=True)
class Region:
    """The region of influence of one part of a combined skill: the basin of its attractor, if latched.

    Attributes:
        part: Counted from 1.
        prior: β; the part acts where its β p is largest.
        attractor: Where it ends.
        radius: Within this distance of the attractor the part provably acts alone; None if none was found, or
            if none is needed because there is a global proof.
        demonstrations: Number of embedded demonstrations.
        selected: Share of their starts that lie in the region; None without demonstrations.
    """

    part: int
    prior: float
    attractor: tuple[float, ...]
    radius: float | None
    demonstrations: int
    selected: float | None


@dataclass(frozen=True)
class Place:
    """What a skill does at one place.

    Attributes:
        position: The place.
        part: Which part acts there, counted from 1; None where all act together.
        weights: Each part's share: of the motion (merged), or β p of it over the sum of all (combined, where
            the largest acts alone). One for a learned skill.
        velocity: ξ̇ there, per second.
        arrives: Whether the motion from there was seen to arrive.
        end: Where it was when it arrived, or when it was given up.
        attractor: Number of the attractor it arrived at, counted from 1: that of the part with this number,
            or the only one; None if it did not arrive.
        time: When it arrived, or was given up, [s].
    """

    position: tuple[float, ...]
    part: int | None
    weights: tuple[float, ...]
    velocity: tuple[float, ...]
    arrives: bool
    end: tuple[float, ...]
    attractor: int | None
    time: float


def regions_of(artifact: Artifact, certificate: Certificate) -> tuple[Region, ...]:
    """Return the regions of a combined skill; none for other skills."""
    skill = artifact.skill
    if not isinstance(skill, CombinedSkill):
        return ()
    from skillctl.evaluate.coverage import selected_shares  # late: other skills need nothing of it

    rows = zip(
        skill.part_priors.tolist(),
        skill.part_attractors.tolist(),
        certificate.parts,
        selected_shares(skill, artifact.demonstrations),
        strict=True,
    )
    return tuple(
        Region(number, prior, tuple(attractor), proof.radius, *share)
        for number, (prior, attractor, proof, share) in enumerate(rows, start=1)
    )


def at(skill: Skill, position: Sequence[float], certificate: Certificate) -> Place:
    """Return what the skill does at a position, by evaluation and one rollout: evidence, not proof.

    Raises:
        UsageError: Another number of coordinates than the skill has, or numbers that are not finite.
    """
    x = np.array(position, dtype=np.float64)
    if x.shape != (skill.dimension,) or not np.isfinite(x).all():
        target = ",".join(f"{value:.4g}" for value in skill.attractors[0])
        raise UsageError(
            f"at: expected {skill.dimension} finite numbers ({', '.join(skill.space.names)}), got {x.size}.",
            hint=f"Separate them by commas, as in --at {target}.",
        )
    proved = [part.period for part in certificate.parts if part.period is not None]
    period = min([LONGEST_PERIOD, *(0.5 * longest for longest in proved)])
    motion = rollout(skill, x[None], duration=STEPS * period, period=period)
    times, path = motion.trajectory(0)
    arrives = bool(motion.arrived[0])
    goals = skill.attractors
    nearest = int(np.linalg.norm(goals - path[-1], axis=1).argmin())
    return Place(
        position=tuple(x.tolist()),
        part=int(skill.part_at(x[None])[0]) + 1 if skill.kind == "combined" else None,
        weights=tuple(skill.part_weights_at(x[None])[0].tolist()),
        velocity=tuple(skill.velocity(x).tolist()),
        arrives=arrives,
        end=tuple(path[-1].tolist()),
        attractor=nearest + 1 if arrives else None,
        time=float(times[-1]),
    )
