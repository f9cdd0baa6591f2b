"""The skill tree as nodes and stacked arrays, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import InvalidModelError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import IDENTITY, Chain, Link, OnPosition
from skillctl.model.coordinates.shears import SHEAR_ARRAYS, Shears
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.model.space import Space
from skillctl.store.errors import Refusal
from skillctl.store.layout import Array
from skillctl.store.schema import ChainNode, CombinedNode, MergedNode, Node, SedsNode

MAX_TREE_DEPTH = 16  # merged skills of merged skills of …

COMPONENT_ARRAYS = ("priors", "means", "covariances", "system_matrices", "residual_covariances")
DENSITY_ARRAYS = ("priors", "means", "covariances")
UNSTORED = "coordinates: only those of learned shears can be stored."


def model_arrays(skill: Skill) -> dict[str, FloatArray]:
    """Return the arrays of all leaves, stacked from left to right, by their path in the artifact."""
    leaves = skill.leaves
    arrays = {
        f"model/{name}": np.concatenate([getattr(leaf, name) for leaf in leaves]) for name in COMPONENT_ARRAYS
    }
    for name in DENSITY_ARRAYS:
        arrays[f"model/density_{name}"] = np.concatenate([getattr(leaf.density, name) for leaf in leaves])
    arrays["model/attractors"] = np.stack([leaf.attractor for leaf in leaves])
    arrays["model/lyapunov"] = np.stack([leaf.lyapunov for leaf in leaves])
    return {**arrays, **_coordinate_arrays(leaves), **_region_arrays(skill)}


def _region_arrays(skill: Skill) -> dict[str, Array]:
    """Return the regions of all acting parts, stacked; nothing where position densities are the regions."""
    stages = skill.parts if isinstance(skill, ChainedSkill) else (skill,)
    firsts = np.cumsum([0] + [len(stage.acting_parts) for stage in stages])
    numbered = [
        (first + number, region)
        for first, stage in zip(firsts, stages, strict=False)
        if isinstance(stage, CombinedSkill)
        for number, region in enumerate(stage.regions)
    ]
    if not numbered:
        return {}
    return {
        **{
            f"regions/{name}": np.concatenate([getattr(region, name) for _, region in numbered])
            for name in DENSITY_ARRAYS
        },
        "regions/part": np.repeat(
            [number for number, _ in numbered], [region.n_components for _, region in numbered]
        ),
    }


def _require_regions(node: Node, arrays: Mapping[str, FloatArray]) -> None:
    """Raise Refusal unless each combined skill has the regions of all its parts, in order, or of none."""
    if "regions/part" not in arrays:
        return
    combined = [parts for parts, stage in _numbered(node) if isinstance(stage, CombinedNode)]
    if not combined:
        raise Refusal("/regions: there is no combined skill that they could belong to")
    owners = arrays["regions/part"]
    found = set(owners.tolist())
    wanted = [number for parts in combined if not found.isdisjoint(parts) for number in parts]
    if (owners[1:] < owners[:-1]).any() or sorted(found) != wanted:
        raise Refusal("/regions/part: must number all parts of a combined skill, in order")


def _numbered(node: Node) -> Iterator[tuple[range, Node]]:
    """Yield each stage of a chain, or the node itself, with the numbers of its acting parts."""
    first = 0
    for stage in node.parts if isinstance(node, ChainNode) else (node,):
        count = len(stage.parts) if isinstance(stage, CombinedNode) else 1
        yield range(first, first + count), stage
        first += count


def _regions(arrays: Mapping[str, Array], parts: range) -> tuple[GaussianMixture, ...]:
    """Return the region of each part of a combined skill; none if there are none.

    Raises:
        InvalidModelError: The numbers do not form mixtures.
    """
    owners = arrays.get("regions/part", np.zeros(0))
    if parts[0] not in owners:
        return ()
    try:
        return tuple(
            GaussianMixture(*(arrays[f"regions/{name}"][owners == part] for name in DENSITY_ARRAYS))
            for part in parts
        )
    except InvalidModelError as error:
        raise InvalidModelError(f"regions: {error}") from error


def _coordinate_arrays(leaves: Sequence[SedsSkill]) -> dict[str, Array]:
    """Return the shears of all leaves, stacked, with empty bumps added to those of fewer; {} without any."""
    chains = [leaf.coordinates.links for leaf in leaves]
    if not any(chains):
        return {}
    size = leaves[0].space.positions
    shears = [
        (number, _shears_of(link, bends_all=leaves[0].space.flat))
        for number, chain in enumerate(chains)
        for link in chain
    ]
    if max(map(len, chains)) > 1 or any(len(link.linear) != size for _, link in shears):
        raise InvalidModelError(UNSTORED)
    linear = np.tile(np.eye(size), (len(leaves), 1, 1))
    bumps = max(link.coefficients.shape[1] for _, link in shears)
    for number, link in shears:
        linear[number] = link.linear
    padding = [((0, 0), (0, bumps - link.coefficients.shape[1]), (0, 0)) for _, link in shears]
    return {
        "coordinates/linear": linear,
        **{
            f"coordinates/{name}": np.concatenate([getattr(link, name) for _, link in shears])
            for name in ("directions", "firsts", "spacings")
        },
        "coordinates/coefficients": np.concatenate(
            [np.pad(link.coefficients, pad) for (_, link), pad in zip(shears, padding, strict=True)]
        ),
        "coordinates/leaf": np.repeat(
            [number for number, _ in shears], [len(link.directions) for _, link in shears]
        ),
    }


def _shears_of(link: Link, *, bends_all: bool) -> Shears:
    """Return the learned shears that bend all coordinates of an offset, or its position alone."""
    bent = link.link if isinstance(link, OnPosition) else link
    if not isinstance(bent, Shears) or bends_all == isinstance(link, OnPosition):
        raise InvalidModelError(UNSTORED)
    return bent


def _coordinates(leaf: int, arrays: Mapping[str, Array], space: Space) -> Chain:
    """Return the coordinates of a leaf.

    Raises:
        Refusal: A leaf without shears has a linear part other than the identity.
        InvalidModelError: The map is not invertible, or cannot be computed.
    """
    if "coordinates/leaf" not in arrays:
        return IDENTITY
    rows = arrays["coordinates/leaf"] == leaf
    linear: FloatArray = arrays["coordinates/linear"][leaf]
    if not rows.any():
        if (linear != np.eye(len(linear))).any():
            raise Refusal(f"/coordinates/linear: leaf {leaf} has no shears, but is not the identity")
        return IDENTITY
    shears = Shears(linear, *(arrays[f"coordinates/{name}"][rows] for name in SHEAR_ARRAYS[1:]))
    return Chain((shears if space.flat else OnPosition(shears, space.positions),))


class _Cursor:
    """The next leaf, component and density component, counted from left to right."""

    def __init__(self) -> None:
        self.leaf = self.component = self.density = 0

    def advance(self, n_components: int, n_density: int) -> SedsNodeRanges:
        """Return leaf index, component range and density range of the next leaf."""
        ranges = (
            self.leaf,
            (self.component, self.component + n_components),
            (self.density, self.density + n_density),
        )
        self.leaf, self.component, self.density = self.leaf + 1, ranges[1][1], ranges[2][1]
        return ranges


SedsNodeRanges = tuple[int, tuple[int, int], tuple[int, int]]


def node_of(skill: Skill) -> Node:
    """Return the tree of a skill: everything that ``model_arrays`` does not hold."""
    return _node(skill, _Cursor())


def _node(skill: Skill, cursor: _Cursor) -> Node:
    if isinstance(skill, SedsSkill):
        leaf, components, density = cursor.advance(skill.n_components, skill.density.n_components)
        return SedsNode(leaf=leaf, components=components, density=density, speed=float(skill.speed))
    parts: Any = tuple(_node(part, cursor) for part in skill.parts)
    if isinstance(skill, MergedSkill):
        return MergedNode(
            parts=parts,
            part_weights=tuple(skill.shares.tolist()),
            gate=skill.gate,
            parameters=dict(skill.parameters),
            speed=float(skill.speed),
        )
    if isinstance(skill, ChainedSkill):
        return ChainNode(
            parts=parts,
            levels=tuple(skill.levels.tolist()),
            events=skill.events,
            on_jump=skill.on_jump,
            disturbance_distance=float(skill.disturbance_distance),
        )
    return CombinedNode(
        parts=parts,
        part_priors=tuple(skill.shares.tolist()),
        gate=skill.gate,
        disturbance_distance=float(skill.disturbance_distance),
        speed=float(skill.speed),
    )


def unknown_gates(node: Node) -> list[str]:
    """Return the gates in a tree that no skill of this build can have."""
    if isinstance(node, SedsNode):
        return []
    gates = [gate for part in node.parts for gate in unknown_gates(part)]
    if isinstance(node, ChainNode):
        return gates
    known = MERGE_GATES if isinstance(node, MergedNode) else COMBINE_GATES
    return gates if node.gate in {gate.name for gate in known} else [node.gate, *gates]


def skill_of(node: Node, arrays: Mapping[str, FloatArray], space: Space) -> Skill:
    """Return the skill of a tree and its stacked arrays.

    Raises:
        Refusal: The tree is too deep, or its ranges do not cover all rows exactly once, in order.
        InvalidModelError: The numbers do not form a skill.
    """
    _require_tiling(node, arrays)
    _require_regions(node, arrays)
    stages = tuple(_skill(stage, arrays, space, parts) for parts, stage in _numbered(node))
    if not isinstance(node, ChainNode):
        (skill,) = stages
        return skill
    return ChainedSkill(stages, np.array(node.levels), node.events, node.on_jump, node.disturbance_distance)


def _require_tiling(node: Node, arrays: Mapping[str, FloatArray]) -> None:
    cursor = _Cursor()
    for leaf in _leaves(node, 1):
        (k0, k1), (m0, m1) = leaf.components, leaf.density
        stated = (leaf.leaf, leaf.components, leaf.density)
        if cursor.advance(k1 - k0, m1 - m0) != stated:
            raise Refusal(
                f"/meta.json: skill: leaf {leaf.leaf} does not continue where the one before it ends"
            )
    owners = arrays.get("coordinates/leaf", np.zeros(1, dtype=np.int64))
    if owners[0] < 0 or owners[-1] >= cursor.leaf or (owners[1:] < owners[:-1]).any():
        raise Refusal(f"/coordinates/leaf: must be leaf numbers below {cursor.leaf}, in order")
    counted = (cursor.leaf, cursor.component, cursor.density)
    stored = tuple(len(arrays[f"model/{name}"]) for name in ("attractors", "priors", "density_priors"))
    if counted != stored:
        raise Refusal(
            f"/meta.json: skill: its leaves, components and density components number {counted}, "
            f"but the arrays hold {stored}"
        )


def _leaves(node: Node, depth: int) -> Iterator[SedsNode]:
    if depth > MAX_TREE_DEPTH:
        raise Refusal(f"/meta.json: skill: parts nested more than {MAX_TREE_DEPTH} deep")
    if isinstance(node, SedsNode):
        yield node
    else:
        for part in node.parts:
            yield from _leaves(part, depth + 1)


def _skill(node: Node, arrays: Mapping[str, FloatArray], space: Space, numbers: range) -> Skill:
    """Return a skill that is no chain, whose acting parts have these numbers."""
    if isinstance(node, SedsNode):
        return _seds_skill(node, arrays, space)
    parts: Any = tuple(_skill(part, arrays, space, numbers) for part in node.parts)
    if isinstance(node, MergedNode):
        weights = np.array(node.part_weights)
        return MergedSkill(parts, weights, node.gate, node.speed, node.parameters)
    assert isinstance(node, CombinedNode)
    priors, regions = np.array(node.part_priors), _regions(arrays, numbers)
    return CombinedSkill(parts, priors, node.gate, node.disturbance_distance, node.speed, regions)


def _seds_skill(node: SedsNode, arrays: Mapping[str, FloatArray], space: Space) -> SedsSkill:
    rows, density_rows = slice(*node.components), slice(*node.density)
    try:
        density = GaussianMixture(*(arrays[f"model/density_{name}"][density_rows] for name in DENSITY_ARRAYS))
        return SedsSkill(
            **{name: arrays[f"model/{name}"][rows] for name in COMPONENT_ARRAYS},
            attractor=arrays["model/attractors"][node.leaf],
            lyapunov=arrays["model/lyapunov"][node.leaf],
            density=density,
            space=space,
            speed=node.speed,
            coordinates=_coordinates(node.leaf, arrays, space),
        )
    except InvalidModelError as error:
        raise InvalidModelError(f"leaf {node.leaf}: {error}") from error
