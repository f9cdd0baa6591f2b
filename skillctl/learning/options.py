"""What a user may choose about learning, and the work each preset spends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from skillctl.errors import UsageError
from skillctl.options import option, require_choices

Objective: TypeAlias = Literal["reproduction", "mse", "likelihood"]
Metric: TypeAlias = Literal["learned", "euclidean"]
Coordinates: TypeAlias = Literal["auto", "identity", "shears"]
Preset: TypeAlias = Literal["fast", "default", "quality"]

LEARNING = "Learning"


@dataclass(frozen=True, slots=True)
class Effort:
    """How much work a preset spends.

    Attributes:
        starts: Number of initial partitions tried.
        probe_steps: Optimiser steps each start gets before the best one goes on.
        polish_steps: Optimiser steps the best start gets.
        samples: Points kept per demonstration, uniform in time.
        components: Number of components unless the user gives one, or the data cannot carry as many.
    """

    starts: int
    probe_steps: int
    polish_steps: int
    samples: int
    components: int

    def samples_of(self, count: int) -> int:
        """Return the points to keep of each of ``count`` demonstrations; more of each if they are few."""
        return max(self.samples, -(-FEWEST_POINTS // count))


FEWEST_POINTS = 120  # in all: what a handful of components in three dimensions need

EFFORTS: dict[Preset, Effort] = {
    "fast": Effort(starts=1, probe_steps=6, polish_steps=12, samples=30, components=7),
    "default": Effort(starts=3, probe_steps=8, polish_steps=30, samples=30, components=7),
    "quality": Effort(starts=5, probe_steps=12, polish_steps=60, samples=40, components=9),
}


def read_components(text: str) -> int | Literal["auto"]:
    """Read a number of components, or ``auto``; or raise ValueError."""
    if text == "auto":
        return "auto"
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{text!r} is neither a number nor auto.") from None


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """Options of ``fit``.

    Attributes:
        objective: ``reproduction`` (velocities and rollouts), ``mse`` (velocities, least squares) or
            ``likelihood`` (Eq. 6).
        metric: ``learned`` finds the Lyapunov matrix P from the data; ``euclidean`` is P = I (Eq. 5).
        coordinates: ``identity`` measures that distance in the state itself; ``shears`` in learned
            coordinates, with which V need not be an ellipse; ``auto`` learns them where no ellipse suits.
        n_components: K. None: seven (nine with ``quality``), or fewer if the data cannot carry as many.
            ``auto``: chosen by the error on demonstrations left out (by BIC for a single demonstration).
        preset: How much work to spend.
        seed: Seed of the k-means++ starts.
        slowest_rate: Certified decay of V in the data's own time unit (its rms distance from the target
            over its rms speed): every Aₖ keeps at least this rate. With 0.001 a motion still arrives, but
            may be very slow.
        period: Controller period Δt for which the skill must stay certified, [s]; 0: continuous-time
            stability only.
    """

    objective: Objective = option(
        "reproduction",
        group=LEARNING,
        help="What is optimised. reproduction: velocities and whole motions; mse: velocities; likelihood: "
        "the likelihood of the demonstrations.",
    )
    metric: Metric = option(
        "learned",
        group=LEARNING,
        help="Distance in which the motion approaches the target: learned from the data, or the plain one.",
    )
    coordinates: Coordinates = option(
        "auto",
        group=LEARNING,
        help="Where that distance is measured. shears: in learned coordinates, for motions that bend back; "
        "identity: in the state itself; auto: shears where no ellipse suits the motion.",
    )
    n_components: int | Literal["auto"] | None = option(
        name="components",
        read=read_components,
        metavar="N|auto",
        group=LEARNING,
        help="Number of Gaussian components; auto: chosen by the error on demonstrations left out. "
        "Default: 7 (9 with --preset quality), or fewer for little data.",
    )
    preset: Preset = option("default", group=LEARNING, help="How much work to spend.")
    seed: int = option(0, metavar="N", group=LEARNING, help="Seed of the random starts.")
    slowest_rate: float = option(
        0.03,
        metavar="R",
        group=LEARNING,
        help="Decay rate that every component keeps at least, in the motion's own unit of time.",
    )
    period: float = option(
        0.01,
        metavar="S",
        group=LEARNING,
        help="Controller period in seconds that the proof must cover; 0: none.",
    )

    def __post_init__(self) -> None:
        require_choices(self)
        if isinstance(self.n_components, int) and self.n_components < 1:
            raise UsageError(f"components: must be at least 1, got {self.n_components}.")
        if not 0 < self.slowest_rate <= 1:
            raise UsageError(f"slowest rate: must be above 0 and at most 1, got {self.slowest_rate:g}.")
        if not 0 <= self.period < math.inf:
            raise UsageError(f"period: must be zero or a positive number of seconds, got {self.period:g}.")
        if self.seed < 0:
            raise UsageError(f"seed: must be zero or a positive whole number, got {self.seed}.")

    @property
    def effort(self) -> Effort:
        """How much work the preset spends."""
        return EFFORTS[self.preset]
