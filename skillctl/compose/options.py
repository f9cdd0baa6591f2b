"""What a user may choose about merging and combining skills."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from skillctl.errors import UsageError
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES, gate_parameters, merge_gate
from skillctl.options import (
    MOTION,
    Length,
    Named,
    Option,
    changed,
    option,
    read_length,
    read_numbers,
    read_point,
    require_choices,
)

if TYPE_CHECKING:
    from skillctl.arrays import FloatArray
    from skillctl.model.chained import ChainedSkill
    from skillctl.model.combined import CombinedSkill
    from skillctl.model.merged import MergedSkill
    from skillctl.model.skill import Skill


SEQUENCE = "sequence"  # the name that chaining has among the gates of combining
Value = TypeVar("Value")


def _numbered(text: str, sign: str, read: Callable[[str], Value], example: str) -> tuple[int, Value]:
    """Read the number of a stage, a sign, and what is said of the stage; or raise ValueError."""
    number, found, value = text.partition(sign)
    if not (found and number.strip().isdecimal()):
        raise ValueError(f"{text!r} does not name a stage, as in {example}.")
    return int(number), read(value)


def read_within(text: str) -> tuple[int | None, Length]:
    """Read ``5mm``, or ``2:5mm`` for one stage; or raise ValueError."""
    return _numbered(text, ":", read_length, "2:5mm") if ":" in text else (None, read_length(text))


def read_event(text: str) -> tuple[int, str]:
    """Read ``2:close`` or ``2:wait 0.5``, or raise ValueError."""
    return _numbered(text, ":", lambda event: " ".join(event.split()), "2:close")


def read_stage_target(text: str) -> tuple[int, tuple[float, ...]]:
    """Read ``1=0.4,0,0.3``, or raise ValueError."""
    return _numbered(text, "=", read_point, "1=0.4,0,0.3")


def _target() -> Any:
    return option(
        read=read_point,
        metavar="X,Y,Z[,QX,QY,QZ,QW]",
        group=MOTION,
        help="Where the motion ends, in the unit of the skill; for poses as a quaternion, too.",
    )


def _turn() -> Any:
    return option(False, group=MOTION, help="Turn whole motions of poses with their target.")


def _gate(default: str, gates: Sequence[Any], **more: str) -> Any:
    gates_help = {**{gate.name: gate.help for gate in gates}, **more}
    text = "; ".join(f"{name}: {what}" for name, what in gates_help.items())
    return option(default, choices=tuple(gates_help), group=MOTION, help=f"{text}.")


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
        gate: When the acting part is chosen: the name of one of ``skillctl.model.gates.COMBINE_GATES``; or
            ``sequence``, of which ``chained`` has the options.
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
    gate: str = _gate("latched", COMBINE_GATES, sequence="one after the other, as `skillctl chain` does it")
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

    def chained(self, hand_over: HandOver) -> ChainOptions | None:
        """Return the options of the chain that is meant; None if the gate is another.

        Raises:
            UsageError: Options without effect.
        """
        sequence = self.gate == SEQUENCE
        own = ("gate", "turn", "disturbance_distance")
        unused = [each for each in changed(self if sequence else hand_over) if each.field not in own]
        if not sequence:
            if unused:
                raise UsageError(f"{unused[0].key}: only stages hand over.", hint=f"Add --gate {SEQUENCE}.")
            return None
        if unused:
            raise UsageError(
                f"{unused[0].key}: stages act one after the other, each with its own target.",
                hint="Leave it out; `skillctl chain --target STAGE=X,Y,Z` moves the target of a stage.",
            )
        return ChainOptions(**vars(hand_over), turn=self.turn, disturbance_distance=self.disturbance_distance)

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


@dataclass(frozen=True)
class HandOver:
    """When one stage of a chain hands over to the next, and what happens then.

    Attributes:
        within: How near to its target a stage is over, one entry ``(None, distance)`` for all stages, and
            ``(stage, distance)`` for one; by default ``compose.chain.WITHIN_SHARE`` of what it was taught.
        event: After which stage, counted from 1, comes what: ``(2, "close")``, ``(2, "wait 0.5")``.
        on_jump: Which stage goes on after a jump of the state: ``stay`` or ``back``.
    """

    within: tuple[tuple[int | None, Length], ...] = option(
        (),
        repeated=True,
        read=read_within,
        metavar="[STAGE:]D",
        group=MOTION,
        help="A stage is over this near to its target: 5mm, or 2:5mm for stage 2; of poses, angles count by "
        "the characteristic length. Default: 1 % of the stage's extent.",
    )
    event: tuple[tuple[int, str], ...] = option(
        (),
        repeated=True,
        read=read_event,
        metavar="STAGE:EVENT",
        group=MOTION,
        help="What happens once a stage is over, before the next: 2:close, 2:open, '2:wait 0.5' (seconds), "
        "or another word that the robot's program knows. May be repeated.",
    )
    on_jump: Literal["stay", "back"] = option(
        "stay",
        group=MOTION,
        help="After a jump of the state, stay: the stage goes on from there; back: of the stages begun so "
        "far, the one that was taught nearest.",
    )


@dataclass(frozen=True)
class ChainOptions(HandOver):
    """How skills are chained; see ``skillctl.compose.chain``.

    Attributes:
        target: Where stages end, ``(stage, target)`` in the unit of the skills; others keep their targets.
        turn: Motions of poses turn with these targets.
        disturbance_distance: A jump is by more than this; None: from the extent of the skills.
    """

    target: tuple[tuple[int, tuple[float, ...]], ...] = option(
        (),
        repeated=True,
        read=read_stage_target,
        metavar="STAGE=X,Y,Z[,QX,QY,QZ,QW]",
        group=MOTION,
        help="Where a stage ends, in the unit of the skills; for poses as a quaternion, too.",
    )
    turn: bool = _turn()
    disturbance_distance: float | None = option(
        metavar="D",
        group=MOTION,
        help="The state has jumped if it is off by more than this, in the unit of the skills. "
        "Default: 5 % of the smallest skill's extent.",
    )

    def __post_init__(self) -> None:
        require_choices(self)

    def staged(self, parts: Sequence[Skill]) -> tuple[Skill, ...]:
        """Return the stages, and check what is said of them."""
        from skillctl.compose.chain import staged  # late: it imports NumPy

        numbers = [number for number, _ in self.target]
        if len(set(numbers)) < len(numbers):
            raise UsageError("target: a stage has one target only.")
        return staged(parts, targets=dict(self.target), turn=self.turn)

    def distances(self, stages: Sequence[Skill]) -> tuple[float, ...]:
        """Return how near to its target each stage is over, in the unit of the skills."""
        from skillctl.compose.chain import stage_index, usual_distance

        unit = stages[0].space.unit
        distances = [usual_distance(stage) for stage in stages]
        for number, (value, given) in sorted(self.within, key=lambda each: each[0] or 0):
            if given not in ("", unit):
                raise UsageError(f"within: the skills count in {unit}, not in {given}.")
            if not 0 < value < float("inf"):
                raise UsageError(f"within: must be positive, got {value:g}.")
            if number is None:
                distances = [value] * len(stages)
            else:
                distances[stage_index("within", number, len(stages))] = value
        return tuple(distances)

    def chain(self, stages: Sequence[Skill], levels: Sequence[float]) -> ChainedSkill:
        """Return the chain whose stages are over at some levels of V."""
        from skillctl.compose.chain import chained

        return chained(
            stages,
            levels,
            events=self.event,
            on_jump=self.on_jump,
            disturbance_distance=self.disturbance_distance,
        )

    def recorded(self) -> dict[str, Any]:
        """Return what decides the result, as a skill's record has it."""
        return {
            "within": tuple(
                f"{'' if n is None else f'{n}:'}{value!r}{unit}" for n, (value, unit) in self.within
            ),
            "event": tuple(f"{number}:{event}" for number, event in self.event),
            "on_jump": self.on_jump,
            "target": tuple(f"{n}={','.join(map(repr, point))}" for n, point in self.target),
            "disturbance_distance": self.disturbance_distance,
            **({"turn": True} if self.turn else {}),
        }
