"""The numbers of a skill as C tables, and which parts of the runtime it needs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.codegen.text import braced, constant, number, quoted
from skillctl.errors import UsageError
from skillctl.model import limits
from skillctl.model.chained import WAIT, ChainedSkill
from skillctl.model.coordinates.chain import Link, OnPosition
from skillctl.model.coordinates.gauge import Gauge
from skillctl.model.coordinates.keep_out import NUDGE, KeepOut
from skillctl.model.coordinates.shears import Shears
from skillctl.model.course import ROUNDING
from skillctl.model.gated import StackedDensities
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import SEAM, Pose
from skillctl.model.skill import Skill
from skillctl.model.space import Euclidean
from skillctl.model.stepper import CLOSE, SHARES

NONE = "NULL"


class Tables:
    """What is generated of a skill; names begin with ``skill`` and get their prefix later.

    Attributes:
        features: Which parts of the runtime it needs, and which not, by name.
        limits: Values of the runtime's macros, by name.
        text: Definitions, each before those that name it.
    """

    def __init__(self, skill: Skill) -> None:
        """Args: skill.

        Raises:
            UsageError: There is no C for one of its kinds of space, coordinates or gates.
        """
        self.features = features_of(skill)
        self._dimension = skill.dimension
        self.limits: dict[str, str] = {}
        self.text: list[str] = []
        parts = skill.acting_parts
        records = [self._part(skill, index) for index in range(len(parts))]
        self._records("skill_part_", records, "skill_part_table_")
        self.text.append(constant("double", "skill_targets", skill.attractors))
        if self.features["STAGES"]:
            stages = [self._stage(skill, *stage) for stage in enumerate(stages_of(skill))]
            self._records("skill_stage_", stages, "skill_stage_table_")
            self.limits["STAGES"] = str(len(stages))
            self.limits["DISTURBANCE"] = number(skill.disturbance_distance)
        self._raise("PARTS_", len(parts))
        self.limits["SPEED_"] = number(skill.outer_speed)
        for name in ("WHOLE", "FOLLOWING", "DESCENT", "CLOSED"):
            self.limits[f"{name}_"] = number(getattr(limits, name))
        self.limits["HALVINGS_"] = str(limits.HALVINGS)
        self.limits["ROUNDING_"] = number(ROUNDING)
        self.limits["TRIALS_"], self.limits["CLOSE_"] = str(SHARES), number(CLOSE)
        if isinstance(skill.space, Pose):
            self.limits["LENGTH"] = number(skill.space.length)
            self.limits["SEAM_"], self.limits["TURN_"] = number(np.pi - SEAM), number(2 * np.pi)

    def _table(self, kind: str, values: Any) -> str:
        """Define a table of numbers, and return its name."""
        name = f"skill_table_{len(self.text)}_"
        self.text.append(constant(kind, name, values))
        return name

    def _records(self, kind: str, records: Iterable[Sequence[str]], name: str = "") -> str:
        """Define a table of records, and return its name."""
        rows = [braced(record) for record in records]
        name = name or f"skill_table_{len(self.text)}_"
        body = ",\n    ".join(rows)
        self.text.append(f"static const {kind} {name}[{len(rows)}] = {{\n    {body}\n}};\n")
        return name

    def _raise(self, limit: str, value: int) -> None:
        """Let a limit be no less than a value."""
        self.limits[limit] = str(max(value, int(self.limits.get(limit, 0))))

    def _part(self, skill: Skill, index: int) -> list[str]:
        part = skill.acting_parts[index]
        fields = [leaf.gated.logits.coefficients for leaf in part.leaves]
        count = sum(map(len, fields))
        self._raise("COMPONENTS_", count)
        record = [
            str(count),
            self._table("double", np.concatenate(fields)),
            self._table("double", part.component_matrices.reshape(count, -1)),
            self._table("double", part.attractor),
            self._table("double", part.anchor),
            self._table("double", part.lyapunov.ravel()),
        ]
        if isinstance(skill, ChainedSkill):
            record += self._chained(skill, index)
        if self.features["MERGED"]:
            mergers = [self._merger(node, first) for node, first in merged_nodes(part)]
            record += [str(len(fields)), self._ends(map(len, fields)), str(len(mergers))]
            record.append(self._records("skill_merger_", mergers) if mergers else NONE)
        if self.features["LINKS"]:
            links = [self._link(link) for link in part.coordinates.links]
            record += [str(len(links)), self._records("skill_link_", links) if links else NONE]
        return record

    def _stage(self, skill: Skill, index: int, stage: Skill) -> list[str]:
        first = sum(len(each.acting_parts) for each in stages_of(skill)[:index])
        record = [str(first), str(len(stage.acting_parts))]
        if self.features["SELECTS"]:
            record.append(NONE)
            if len(stage.acting_parts) > 1:
                regions = self._densities(stage.influences, stage.shares)
                record[-1] = self._records("skill_densities_", [regions])
        if isinstance(skill, ChainedSkill):
            events = [
                (quoted(event), number(float(event.removeprefix(WAIT)) if event.startswith(WAIT) else -1.0))
                for event in skill.events[index]
            ]
            record += [str(len(events)), self._records("skill_event_", events) if events else NONE]
        return record

    def _chained(self, chain: ChainedSkill, index: int) -> list[str]:
        """Return what a part of a chain has beside others."""
        part, stage = chain.acting_parts[index], chain.stage_of(index)
        record = [str(stage), number(math.sqrt(chain.levels[stage]))]
        if self.features["BACK"]:
            density = part.density
            origin = density.priors @ density.means
            self._raise("TERMS_", density.n_components)
            tables = (self._table("double", each) for each in (origin, density.coefficients(origin)))
            record += [str(density.n_components), *tables]
        return record

    def _merger(self, node: Skill, first: int) -> list[str]:
        counts = [part.n_components for part in node.parts]
        self._raise("PARTS_", len(counts))
        record = [str(first), str(len(counts)), self._ends(counts, first), self._table("double", node.shares)]
        if self.features["EXPERTS"]:
            record.append(number(node.parameters.get("sharpness", 0.0)))
        if self.features["SHARED"]:
            record.append(NONE)
            if node.gate == "density":
                densities = self._densities([part.density for part in node.parts], node.shares)
                record[-1] = self._records("skill_densities_", [densities])
        return record

    def _densities(self, mixtures: Sequence[GaussianMixture], weights: FloatArray) -> list[str]:
        quadratics = StackedDensities(mixtures, weights).quadratics
        counts = [mixture.n_components for mixture in mixtures]
        self._raise("TERMS_", sum(counts))
        tables = (
            self._table("double", each) for each in (weights, quadratics.origin, quadratics.coefficients)
        )
        return [str(len(counts)), self._ends(counts), *tables]

    def _link(self, link: Link) -> list[str]:
        inner, size = inner_of(link)
        record = [str(size or self._dimension)]
        if self.features["SHEARS"]:
            record.append(self._shears(inner) if isinstance(inner, Shears) else NONE)
        if self.features["BODIES"]:
            record.append(self._bodies(inner) if isinstance(inner, KeepOut) else NONE)
        return record

    def _shears(self, link: Shears) -> str:
        shears = [
            [
                self._table("double", shear.direction),
                number(shear.per_length),
                number(shear.start),
                str(shear.count),
                self._table("double", shear.cells[:-1].transpose(0, 2, 1).reshape(-1, 4).ravel()),
                self._table("double", shear.shift),
            ]
            for shear in link.shears
        ]
        matrices = (self._table("double", each.ravel()) for each in (link.linear, link.inverse))
        record = [*matrices, str(len(shears)), self._records("skill_shear_", shears)]
        return self._records("skill_shears_", [record])

    def _bodies(self, link: KeepOut) -> str:
        bodies = [self._body(*each) for each in zip(link.gauges, link.reaches.tolist(), strict=True)]
        record = [number(link.stride), str(len(bodies)), self._records("skill_body_", bodies)]
        return self._records("skill_bodies_", [record])

    def _body(self, gauge: Gauge, reach: float) -> list[str]:
        order = [index for members in gauge.groups for index in members]
        return [
            self._table("double", gauge.pole),
            self._table("double", gauge.frame[order].ravel()),
            str(len(gauge.groups)),
            self._ends(map(len, gauge.groups)),
            self._table("double", gauge.below),
            self._table("double", gauge.above),
            *map(number, (gauge.rounding, reach, gauge.radius)),
            self._table("double", NUDGE * np.array(gauge.exit())),
        ]

    def _ends(self, counts: Iterable[int], first: int = 0) -> str:
        return self._table("int", np.array([*accumulate(counts, initial=first)][1:]))


def features_of(skill: Skill) -> dict[str, bool]:
    """Return what of the runtime a skill needs.

    Raises:
        UsageError: There is no C for one of its kinds of space, coordinates or gates.
    """
    space, parts = skill.space, skill.acting_parts
    links = {type(inner_of(link)[0]) for part in parts for link in part.coordinates.links}
    gates = {node.gate for part in parts for node, _ in merged_nodes(part)}
    unknown = [
        *({skill.kind} - {"seds", "merged", "combined", "chain"}),
        *({type(space)} - {Euclidean, Pose}),
        *(links - {Shears, KeepOut}),
        *(gates - {"superposition", "density", "experts"}),
    ]
    if unknown:
        raise UsageError(f"{unknown[0]}: there is no C for it.", hint="Write .json or .npz.")
    selects = any(len(stage.acting_parts) > 1 for stage in stages_of(skill))
    chained = isinstance(skill, ChainedSkill)
    return {
        "CHAIN": chained,
        "BACK": isinstance(skill, ChainedSkill) and skill.on_jump == "back",
        "STAGES": chained or selects,
        "POSE": not space.flat,
        "BENT": not all(part.plain for part in parts),
        "FASTER": skill.outer_speed != 1,
        "SELECTS": selects,
        "RESELECTS": selects and skill.reselects,
        "DENSITIES": selects or "density" in gates,
        "MERGED": bool(gates),
        "SHARED": "density" in gates,
        "EXPERTS": "experts" in gates,
        "LINKS": bool(links),
        "SHEARS": Shears in links,
        "BODIES": KeepOut in links,
    }


def stages_of(skill: Skill) -> tuple[Skill, ...]:
    """Return the stages of a chain; of any other skill itself."""
    return skill.parts if isinstance(skill, ChainedSkill) else (skill,)


def merged_nodes(part: Skill, first: int = 0) -> Iterator[tuple[Skill, int]]:
    """Yield the merged skills of a tree, inner ones first, each with the index of its first component."""
    begin = first
    for each in part.parts:
        yield from merged_nodes(each, begin)
        begin += each.n_components
    if part.parts:
        yield part, first


def inner_of(link: Link) -> tuple[Link, int]:
    """Return the map that a link is, or wraps, and how many coordinates it wraps; zero if all."""
    return (link.link, link.size) if isinstance(link, OnPosition) else (link, 0)
