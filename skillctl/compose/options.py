"""What a user may choose about merging and combining skills."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skillctl.model.gates import COMBINE_GATES, MERGE_GATES, gate_parameters, merge_gate
from skillctl.options import MOTION, Named, Option, option, read_numbers, read_point

if TYPE_CHECKING:
    from skillctl.arrays import FloatArray
    from skillctl.model.combined import CombinedSkill
    from skillctl.model.merged import MergedSkill
    from skillctl.model.skill import Skill


def _target() -> Any:
    return option(
        read=read_point,
        metavar="X,Y,Z[,QX,QY,QZ,QW]",
        group=MOTION,
        help="Where the motion ends, in the unit of the skill; for poses as a quaternion, too.",
    )


def _turn() -> Any:
    return option(False, group=MOTION, help="Turn whole motions of poses with their target.")


def _gate(default: str, gates: Sequence[Any]) -> Any:
    text = "; ".join(f"{gate.name}: {gate.help}" for gate in gates)
    return option(default, choices=tuple(gate.name for gate in gates), group=MOTION, help=f"{text}.")


GATE_PARAMETERS = tuple(
    Named(
        each.name,
        each.default,
        f"Of the {gate.name} gate: {each.help[0].lower()}{each.help[1:]}; at least {each.least:g}.",
    )
    for gate in MERGE_GATES
    for each in gate.parameters
)


@dataclass(frozen=True)
class MergeOptions:
    """How parts are merged; see ``skillctl.compose.merge``.

    Attributes:
        part_weights: Influence of each part; None: equal.
        gate: How the parts act together: the name of one of ``skillctl.model.gates.MERGE_GATES``.
        speed: Factor on the velocities of the parts; None: as fast as the parts were demonstrated.
        target: Where all end, in the unit of the skill; None: at the weighted mean of their targets. Of poses
            with a quaternion (x, y, z, w) behind the position, or else in the mean orientation.
        turn: Motions of poses turn with their target.
        parameters: Of the gate, by their names, as in ``{"sharpness": 4.0}``; the others have their defaults.
    """

    part_weights: tuple[float, ...] | None = option(
        name="weights",
        read=read_numbers,
        metavar="W,W,...",
        group=MOTION,
        help="Influence of each skill, all positive. Default: equal.",
    )
    gate: str = _gate("superposition", MERGE_GATES)
    parameters: Mapping[str, float] = field(
        default_factory=dict, metadata={Option: Option(named=GATE_PARAMETERS, group=MOTION)}
    )
    speed: float | None = option(
        metavar="F",
        group=MOTION,
        help="Factor on the velocities of the skills. Default: one with which motions take as long as those "
        "that were demonstrated.",
    )
    target: tuple[float, ...] | None = _target()
    turn: bool = _turn()

    def prepared(self, parts: Sequence[Skill]) -> tuple[Skill, ...]:
        """Return the parts as they have to be before one P is looked for."""
        from skillctl.compose.parts import prepared  # late: it imports NumPy

        return prepared(parts, self.part_weights, self.target, turn=self.turn)

    def merge(self, parts: Sequence[Skill], lyapunov: FloatArray) -> MergedSkill:
        """Return the merged skill under a common Lyapunov matrix (d, d)."""
        from skillctl.compose.merge import merge  # late: it imports NumPy

        return merge(
            parts,
            part_weights=self.part_weights,
            gate=self.gate,
            speed=1.0 if self.speed is None else self.speed,
            target=self.target,
            turn=self.turn,
            lyapunov=lyapunov,
            parameters=self.parameters,
        )

    def recorded(self) -> dict[str, Any]:
        """Return what decides the result, as a skill's record has it: with all parameters of the gate."""
        parameters = gate_parameters(merge_gate(self.gate), self.parameters)
        return {
            "part_weights": self.part_weights,
            "gate": self.gate,
            **parameters,
            "speed": self.speed,
            "target": self.target,
            **({"turn": True} if self.turn else {}),  # skills of before have no such entry
        }


@dataclass(frozen=True)
class CombineOptions:
    """How parts are combined; see ``skillctl.compose.combine``.

    Attributes:
        part_priors: How readily each part is chosen; None: equally.
        gate: When the acting part is chosen: the name of one of ``skillctl.model.gates.COMBINE_GATES``.
        align: All parts end at one target.
        target: That target, in the unit of the skill; None: the mean of the parts' targets. As of merging.
        turn: Motions of poses turn with it.
        disturbance_distance: A jump by more than this selects again; None: from the extent of the skills.
        calibrate: Choose the priors by the parts' embedded demonstrations.
    """

    part_priors: tuple[float, ...] | None = option(
        name="priors",
        read=read_numbers,
        metavar="B,B,...",
        group=MOTION,
        help="How readily each skill is chosen, all positive. Default: equal.",
    )
    gate: str = _gate("latched", COMBINE_GATES)
    align: bool = option(
        False,
        group=MOTION,
        help="Move all skills to one target: where the motion starts from it decides which acts.",
    )
    target: tuple[float, ...] | None = _target()
    turn: bool = _turn()
    disturbance_distance: float | None = option(
        metavar="D",
        group=MOTION,
        help="A jump by more than this, in the unit of the skills, selects again. "
        "Default: 5 % of the smallest skill's extent.",
    )
    calibrate: bool = option(
        False,
        group=MOTION,
        help="Choose the priors so that motions that start where a skill was taught select it.",
    )

    def prepared(self, parts: Sequence[Skill]) -> tuple[Skill, ...]:
        """Return the parts as they have to be before one P is looked for."""
        from skillctl.compose.parts import prepared  # late: it imports NumPy

        return prepared(parts, self.part_priors, self.target, turn=self.turn)

    def combine(self, parts: Sequence[Skill], lyapunov: FloatArray | None = None) -> CombinedSkill:
        """Return the combined skill, under a common Lyapunov matrix (d, d) if one is given."""
        from skillctl.compose.combine import combine  # late: it imports NumPy

        return combine(
            parts,
            part_priors=self.part_priors,
            gate=self.gate,
            align=self.align,
            target=self.target,
            turn=self.turn,
            disturbance_distance=self.disturbance_distance,
            lyapunov=lyapunov,
        )
