"""The certificate: proof separate from evidence, every number rounded to the safe side."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Literal, TypeAlias

Verdict: TypeAlias = Literal["stable", "not proved", "inconclusive"]
Scope: TypeAlias = Literal["global", "local", "none"]


@dataclass(frozen=True, slots=True)
class ComponentCertificate:
    """What is proved of one component Aₖ under the Lyapunov matrix P of its part.

    Attributes:
        leaf: Which SEDS skill of the part it belongs to, counted from 1.
        component: Which component of that leaf, counted from 1.
        proved: Whether −½(P A + Aᵀ P) − m P ≻ 0 holds exactly, with the margin m of the certificate.
        rate: Its decay rate in floating point, [1/s]: information, not proof. It is negative or zero if V can
            grow, and None if P is too near singular to compute it.
    """

    leaf: int
    component: int
    proved: bool
    rate: float | None


@dataclass(frozen=True, slots=True)
class BlockCertificate:
    """What is proved of the position or the orientation of a pose, which contract by themselves.

    Attributes:
        name: ``position`` or ``orientation``.
        rate: As of the part, [1/s]; of the orientation, the angle to the target's shrinks at it.
        period: As of the part, [s].
    """

    name: str
    rate: float | None
    period: float | None


@dataclass(frozen=True, slots=True)
class PartCertificate:
    """What is proved of one part: a skill whose components all share one P and one attractor.

    Attributes:
        part: Counted from 1; a SEDS or merged skill is its own only part.
        lyapunov_proved: Whether P ≻ 0 holds exactly.
        components: One entry per component of every leaf.
        rate: r with ‖ξ(t) − ξ*‖_P ≤ e^(−rt) ‖ξ(0) − ξ*‖_P while this part acts, proved, [1/s].
        period: Longest controller period at which every step still contracts, proved, [s].
        coordinates: Why its coordinates are not exactly invertible, in sentences; empty if they are.
        coupling: Why position and orientation of poses do not contract by themselves, in sentences; empty if
            they do. Rate and period then hold only as long as no motion comes half a turn from the target.
        blocks: What is proved of position and orientation apart; empty for states without orientation.
        radius: Every motion that starts within this distance of the part's attractor ends there, proved;
            in the unit of the space. Only without a global proof.
        proved: Whether the part, acting alone, converges to its attractor from everywhere.
    """

    part: int
    lyapunov_proved: bool
    components: tuple[ComponentCertificate, ...]
    rate: float | None
    period: float | None
    coordinates: tuple[str, ...] = ()
    radius: float | None = None
    coupling: tuple[str, ...] = ()
    blocks: tuple[BlockCertificate, ...] = ()
    proved: bool = field(init=False)

    def __post_init__(self) -> None:
        numbers = self.rate is not None and self.period is not None
        conditions = self.lyapunov_proved and all(component.proved for component in self.components)
        proved = numbers and conditions and not (self.coordinates or self.coupling)
        object.__setattr__(self, "proved", proved)

    @property
    def failures(self) -> tuple[str, ...]:
        """What could not be proved, one sentence each."""
        name = f"part {self.part}: "
        reasons = [name + sentence for sentence in (*self.coordinates, *self.coupling)]
        if not self.lyapunov_proved:
            reasons.append(name + "P is not positive definite.")
        for c in self.components:
            if not c.proved:
                rate = "unknown" if c.rate is None else f"{c.rate:.3g} 1/s"
                reasons.append(
                    f"{name}leaf {c.leaf}, component {c.component}: P A + Aᵀ P is not negative definite "
                    f"(decay rate {rate})."
                )
        if not (self.proved or reasons):
            reasons.append(name + "its decay rate or period is beyond the range of float64.")
        return tuple(reasons)


@dataclass(frozen=True, slots=True)
class StageCertificate:
    """What is proved of one stage of a chain.

    Attributes:
        stage: Counted from 1.
        parts: Its parts that may act, as the certificate numbers them.
        level: V of the part that acts at which the stage is over.
        within: All states at which it can be over lie this near to its target, in the unit of the space; of
            poses angles count by the characteristic length.
        highest: V is no larger where the stage begins: in the start box, or where the stage before is over.
        arrival: By then the stage is over: (1/r) ln √(highest / level), of the part that takes longest, [s].
        steps: The most steps that a controller of the course's period needs for it.
        waits: How long its events wait, once it is over, [s].

    A bound is None if there is none.
    """

    stage: int
    parts: tuple[int, ...]
    level: float
    within: float
    highest: float | None
    arrival: float | None
    steps: int | None
    waits: float


@dataclass(frozen=True, slots=True)
class Course:
    """By when undisturbed motions of a chain have come to its end, stage by stage.

    Attributes:
        low: Lowest coordinates of the positions in which motions start, in the unit of the space.
        high: The highest ones.
        period: Of the controller whose steps are counted, [s].
        stages: From the first to the last.
        arrival: By then the last stage is over, with all waits, [s]; None if there is no bound. Events that
            are no waits take what they take, in addition.
        steps: The same in steps, at least one for each event; it bounds the time at shorter periods, too.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    period: float
    stages: tuple[StageCertificate, ...]
    arrival: float | None
    steps: int | None


@dataclass(frozen=True, slots=True)
class Sampling:
    """Evidence from seeded rollouts; it can refute, never prove.

    Attributes:
        seed: Of the starts.
        starts: How many were tried, in a box around the data and the attractors.
        arrived: How many came within the arrival distance of an attractor.
        duration: How long each motion was followed, [s].
        period: Step of the rollouts, [s].
        witness: A start whose motion reached no attractor and was coming nearer to none, or None.
        witness_end: Where that motion was at the end; None also where it left all bounds.
    """

    seed: int
    starts: int
    arrived: int
    duration: float
    period: float
    witness: tuple[float, ...] | None
    witness_end: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class Motions:
    """What seeded motions from a box do: how far bounds are from it is seen here, and nothing is proved.

    Attributes:
        seed: Of the starts.
        starts: How many were followed.
        arrived: How many came within the arrival distance of an attractor.
        arrival: When the last of them did, [s]; None if not all did in the time they were followed.
        low: Lowest coordinates that they reached.
        high: Highest coordinates that they reached.
    """

    seed: int
    starts: int
    arrived: int
    arrival: float | None
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Certificate:
    """The answer of ``verify-stability`` for one skill.

    Attributes:
        verdict: ``stable``: proved. ``not proved``: a condition fails, or a witness was found.
            ``inconclusive``: neither a proof nor a witness.
        scope: ``global``: from everywhere. ``local``: within each part's radius. ``none``.
        rate: Proved decay rate within the scope, [1/s].
        period: Longest controller period proved within the scope, [s].
        margin: The exact tests ask for a decay rate of this share of each matrix's largest entry, which
            leaves room for the rounding of the execution.
        parts: Part by part.
        proof: What is proved, in sentences.
        failures: What could not be proved, in sentences.
        evidence: What sampling showed, in sentences.
        sampling: The numbers behind them, or None where a proof made sampling unnecessary.
        digest: Content digest of the artifact this holds for; None for a skill in memory.
        all_weights: Whether the same is proved for all weights of a merged skill's parts, so that they may be
            chosen at run time.
        course: Of a chain, stage by stage; None if its stages are not proved, or do not lead into each other.
    """

    verdict: Verdict
    scope: Scope
    rate: float | None
    period: float | None
    margin: float
    parts: tuple[PartCertificate, ...]
    proof: tuple[str, ...]
    failures: tuple[str, ...]
    evidence: tuple[str, ...]
    sampling: Sampling | None
    digest: str | None = None
    all_weights: bool = False
    course: Course | None = None


def at_least(value: float, digits: int = 3) -> str:
    """Return ``value`` as text, rounded down, so that "at least" stays true."""
    return _rounded(value, Context(prec=digits, rounding=ROUND_FLOOR))


def at_most(value: float, digits: int = 3) -> str:
    """Return ``value`` as text, rounded up, so that "at most" stays true."""
    return _rounded(value, Context(prec=digits, rounding=ROUND_CEILING))


def least_frequency(period: float, digits: int = 3) -> str:
    """Return the lowest frequency [Hz] of controllers that are at least as fast as a period [s], as text.

    1/Δt is rounded to a neighbour that may lie below it, hence the next number above.
    """
    return at_most(math.nextafter(1 / period, math.inf), digits)


def _rounded(value: float, context: Context) -> str:
    return f"{float(context.create_decimal_from_float(value)):g}" if math.isfinite(value) else str(value)
