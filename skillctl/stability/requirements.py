"""Requirements that a user may set for what is proved of a skill."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from skillctl.errors import UsageError
from skillctl.options import option
from skillctl.stability.report import Certificate, at_least, at_most

if TYPE_CHECKING:
    from skillctl.stability.reach import Reach

REQUIRED = "What has to be proved"
DEMOS: Literal["demos"] = "demos"

Ranges: TypeAlias = tuple[tuple[float, float], ...]  # lowest and highest value of each coordinate


def read_box(text: str) -> Ranges:
    """Read ``0.1:0.3,0.2,0:``, a range or a number for each coordinate, or raise ValueError."""
    try:
        return tuple(map(_read_range, text.split(",")))
    except ValueError:
        raise ValueError(f"{text!r} is not a range for each coordinate, as in 0.1:0.3,-0.2:0.2.") from None


def read_start_box(text: str) -> Ranges | Literal["demos"]:
    """Read ``demos``, or a box; or raise ValueError."""
    return DEMOS if text == DEMOS else read_box(text)


def _read_range(text: str) -> tuple[float, float]:
    low, colon, high = text.strip().partition(":")
    if not colon:
        return float(low), float(low)
    return float(low or -math.inf), float(high or math.inf)


@dataclass(frozen=True)
class Requirements:
    """What has to be proved of a skill.

    Attributes:
        scope: ``global``: convergence from everywhere; ``local``: at least from around every attractor.
        period: Every step of a controller with this period must contract, too, [s]; None: no requirement.
        min_rate: The decay rate must be at least this, [1/s]; None: no requirement.
        start_box: Where undisturbed motions start, lowest and highest value of each coordinate; their way and
            arrival are bounded. ``demos``: the box around the starts of the skill's demonstrations.
        stay_in: A box that no motion from the start box may leave; null: no limit on that side.
        signer: Public key (``ed25519:…``) that must have signed the skill; None asks for no signature.
    """

    scope: Literal["global", "local"] = option(
        "global",
        name="require",
        group=REQUIRED,
        help="global: from everywhere; local: at least from around every target.",
    )
    period: float | None = option(
        metavar="S", group=REQUIRED, help="Every step of a controller with this period contracts, too."
    )
    min_rate: float | None = option(
        metavar="R", group=REQUIRED, help="A decay rate of at least this, in 1/s."
    )
    start_box: Ranges | Literal["demos"] | None = option(
        read=read_start_box,
        metavar="X1:X2,Y1:Y2,…|demos",
        group=REQUIRED,
        help="Bound where motions from this box go, and when they arrive. demos: the box around the starts "
        "of the skill's demonstrations.",
    )
    stay_in: Ranges | None = option(
        read=read_box,
        metavar="X1:X2,Y1:Y2,…",
        group=REQUIRED,
        help="Undisturbed motions from the start box never leave this box. A side may be open, as in 0:.",
    )
    signer: str | None = None

    def __post_init__(self) -> None:
        if self.stay_in is not None and self.start_box is None:
            raise UsageError("stay-in: where the motions start is not given.", hint="Add --start-box.")
        for name, ranges in (("start-box", self.start_box), ("stay-in", self.stay_in)):
            for low, high in () if ranges is None or ranges == DEMOS else ranges:
                if not low <= high:
                    raise UsageError(f"{name}: a range must not end before it starts, got {low:g}:{high:g}.")
                if name == "start-box" and not math.isfinite(high - low):
                    raise UsageError(f"start-box: both ends must be finite, got {low:g}:{high:g}.")
        for name, value, unit in (("period", self.period, "seconds"), ("min-rate", self.min_rate, "1/s")):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"{name}: must be a positive number of {unit}, got {value:g}.")

    def reached_by(self, certificate: Certificate) -> bool:
        """Return whether a certificate holds for all motions that the required scope covers."""
        return certificate.scope in ("global", self.scope)

    def unmet_by(self, certificate: Certificate, reach: Reach | None = None) -> tuple[str, ...]:
        """Return the requirements that are not met, in sentences; not the signature.

        Args:
            certificate: What is proved of a skill.
            reach: How far its motions from the start box provably go; None if nothing is proved.
        """
        if not self.reached_by(certificate):
            return (f"Required is a {self.scope} proof; proved is {certificate.scope}.",)
        numbers = tuple(
            f"Required is {what} of {required:g} {unit}; proved is "
            f"{'none' if proved is None else at_least(proved)} {unit}."
            for what, required, proved, unit in (
                ("a controller period", self.period, certificate.period, "s"),
                ("a decay rate", self.min_rate, certificate.rate, "1/s"),
            )
            if required is not None and (proved is None or proved < required)
        )
        return numbers + (() if self.stay_in is None else _ways_out(self.stay_in, reach))


def _ways_out(stay_in: Ranges, reach: Reach | None) -> tuple[str, ...]:
    """Return on which sides motions may leave a box, and how far, in sentences."""
    if reach is None:
        return ("Required is a box that motions stay in; no bound of their way is proved.",)
    ways = []
    seen = reach.measured
    for i, (low, high) in enumerate(stay_in):
        sides = (
            ("≥", low, at_least(reach.low[i]), low - reach.low[i], low - seen.low[i]),
            ("≤", high, at_most(reach.high[i]), reach.high[i] - high, seen.high[i] - high),
        )
        for sign, limit, bound, beyond, sampled in sides:
            if beyond > 0:
                does = "leave" if sampled > 0 else "may leave"
                ways.append(
                    f"Motions {does} the box: required is {reach.names[i]} {sign} {limit:g} {reach.unit}; "
                    f"proved is {sign} {bound} {reach.unit}, {at_most(beyond)} {reach.unit} beyond."
                )
    return tuple(ways)
