"""What is in a skill: its tree, its numbers, where it comes from, what is proved of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.arrays import FloatArray
from skillctl.evaluate.place import Place, Region, at, regions_of
from skillctl.evaluate.timeline import Timeline, timeline_of
from skillctl.model.coordinates.chain import Chain, Link, OnPosition
from skillctl.model.coordinates.shears import Shears
from skillctl.model.joint import JointMixture, joint_mixture
from skillctl.model.pose import Pose
from skillctl.model.skill import Kind, Skill
from skillctl.model.space import Space
from skillctl.rotations import roll_pitch_yaw
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Artifact, DemonstrationReport, Lock, Operation, Provenance
from skillctl.store.source import open_skill


@dataclass(frozen=True, eq=False)
class Leaf:
    """One learned skill of the tree.

    Attributes:
        leaf: Counted from 1, from left to right.
        part: Part of the whole skill it belongs to, counted from 1; of a chain, its stage.
        n_components: K.
        speed: Its own factor on all velocities, already in the mixture.
        attractor, lyapunov, system_matrices: ξ* (d,), P (d, d), Aₖ (K, d, d) [1/s].
        joint_mixture: The same as a mixture over positions and velocities, in its coordinates.
        shears: How many shears its coordinates have; none if it moves the state itself.
        demonstrations: Number of embedded demonstrations.
        target: The attractor in the numbers in which a target is given: a pose as x, y, z, qx, qy, qz, qw.
        roll_pitch_yaw: Its orientation as angles about the fixed axes x, then y, then z, [rad]; None if it
            has none.
    """

    leaf: int
    part: int
    n_components: int
    speed: float
    attractor: FloatArray
    lyapunov: FloatArray
    system_matrices: FloatArray
    joint_mixture: JointMixture
    shears: int
    demonstrations: int
    target: tuple[float, ...]
    roll_pitch_yaw: FloatArray | None


@dataclass(frozen=True)
class Node:
    """One skill of the tree: how its parts act together; a SEDS skill has none.

    Attributes:
        kind: ``seds``, ``merged``, ``combined`` or ``chain``.
        share: Weight or prior in the skill above; 1 for the whole; the same for all stages of a chain.
        gate, disturbance_distance: None where the kind of skill has none.
        parameters: Of the gate, by name.
        speed: Factor on all velocities.
        parts: From left to right.
    """

    kind: Kind
    share: float
    gate: str | None
    parameters: dict[str, float]
    disturbance_distance: float | None
    speed: float
    parts: tuple[Node, ...]


@dataclass(frozen=True)
class StateMeaning:
    """What the numbers of a state mean.

    Attributes:
        names: One name per coordinate.
        unit: Unit of a position, ``m`` or ``rad``; velocities are per second.
        frame: Frame in which positions are given.
        kind: Which space of states it is.
        units: Unit of each coordinate.
        length: ℓ of poses, how far apart in metres counts as far as one radian, [m/rad]; None of others.
    """

    names: tuple[str, ...]
    unit: str
    frame: str
    kind: str
    units: tuple[str, ...]
    length: float | None

    @classmethod
    def of(cls, space: Space) -> StateMeaning:
        """Return what a space says of a state."""
        length = space.length if isinstance(space, Pose) else None
        return cls(space.names, space.unit, space.frame, space.kind, space.units, length)


@dataclass(frozen=True, eq=False)
class InspectReport:
    """What an artifact holds.

    Attributes:
        skill, path, digest: Its name, file and identity.
        kind: Of the whole skill.
        space: Names, unit and frame of a state.
        tree: The skill and its parts.
        leaves: The learned skills at the ends of the tree.
        certificate: What is proved of it, derived now.
        regions: Of a combined skill, the region of each part, and so of a chain's stages; empty for others.
        timeline: Of a chain, its stages; None of others.
        at: What it does at the position that was given; None without one.
        reports: How well each leaf repeats each of its demonstrations.
        operation, provenance: The command that made it, its inputs and parents.
    """

    skill: str
    path: Path
    digest: str
    kind: Kind
    space: StateMeaning
    tree: Node
    leaves: tuple[Leaf, ...]
    certificate: Certificate
    regions: tuple[Region, ...]
    at: Place | None
    reports: tuple[DemonstrationReport, ...]
    operation: Operation
    provenance: Provenance
    timeline: Timeline | None


def inspect(
    reference: str | Path,
    *,
    store: Path | None = None,
    lock: Lock | None = None,
    position: Sequence[float] | None = None,
) -> InspectReport:
    """Return what is in the skill that a reference names.

    Args:
        reference: File, or name of the store.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        position: Also report what the skill does at this position, given as a target is.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill.
        UsageError: A position of another dimension, or not finite.
    """
    source = open_skill(reference, store, lock)
    artifact, skill = source.artifact, source.skill
    tree = _node(skill, 1.0)
    certificate = certify(skill, digest=artifact.digest)
    return InspectReport(
        skill=source.name,
        path=source.located.path,
        digest=artifact.digest,
        kind=tree.kind,
        space=StateMeaning.of(skill.space),
        tree=tree,
        leaves=_leaves(artifact),
        certificate=certificate,
        regions=regions_of(artifact, certificate),
        at=None if position is None else at(skill, position, certificate),
        reports=artifact.reports,
        operation=artifact.operation,
        provenance=artifact.provenance,
        timeline=timeline_of(artifact, certificate),
    )


def _node(skill: Skill, share: float) -> Node:
    jumps = skill.kind in ("combined", "chain")
    return Node(
        kind=skill.kind,
        share=share,
        gate=skill.gate or None,
        parameters=dict(skill.parameters),
        disturbance_distance=skill.disturbance_distance if jumps else None,
        speed=skill.speed,
        parts=tuple(_node(part, float(s)) for part, s in zip(skill.parts, skill.shares, strict=True)),
    )


def _bent(coordinates: Chain) -> tuple[Link, ...]:
    """Return the links of coordinates, those of positions alone as what they do to these."""
    return tuple(link.link if isinstance(link, OnPosition) else link for link in coordinates.links)


def _leaves(artifact: Artifact) -> tuple[Leaf, ...]:
    members = enumerate(artifact.skill.parts or (artifact.skill,), start=1)
    owned = [(part, leaf) for part, member in members for leaf in member.leaves]
    return tuple(
        Leaf(
            leaf=number,
            part=part,
            n_components=leaf.n_components,
            speed=leaf.speed,
            attractor=leaf.attractor,
            lyapunov=leaf.lyapunov,
            system_matrices=leaf.system_matrices,
            joint_mixture=joint_mixture(leaf),
            shears=sum(len(link.directions) for link in _bent(leaf.coordinates) if isinstance(link, Shears)),
            demonstrations=0 if taught is None else len(taught),
            target=leaf.space.given(leaf.attractor),
            roll_pitch_yaw=None if turns is None else roll_pitch_yaw(turns),
        )
        for number, ((part, leaf), taught) in enumerate(
            zip(owned, artifact.demonstrations, strict=True), start=1
        )
        for turns in [leaf.space.turns(leaf.attractor)]
    )
