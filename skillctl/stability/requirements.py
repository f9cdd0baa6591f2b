"""Requirements that a user may set for what is proved of a skill."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from skillctl.errors import UsageError
from skillctl.options import option
from skillctl.stability.report import Certificate, at_least

REQUIRED = "What has to be proved"


@dataclass(frozen=True)
class Requirements:
    """What has to be proved of a skill.

    Attributes:
        scope: ``global``: convergence from everywhere; ``local``: at least from around every attractor.
        period: Every step of a controller with this period must contract, too, [s]; None: no requirement.
        min_rate: The decay rate must be at least this, [1/s]; None: no requirement.
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
    signer: str | None = None

    def __post_init__(self) -> None:
        for name, value, unit in (("period", self.period, "seconds"), ("min-rate", self.min_rate, "1/s")):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"{name}: must be a positive number of {unit}, got {value:g}.")

    def reached_by(self, certificate: Certificate) -> bool:
        """Return whether a certificate holds for all motions that the required scope covers."""
        return certificate.scope in ("global", self.scope)

    def unmet_by(self, certificate: Certificate) -> tuple[str, ...]:
        """Return the requirements that a certificate does not meet, in sentences; not the signature."""
        if not self.reached_by(certificate):
            return (f"Required is a {self.scope} proof; proved is {certificate.scope}.",)
        return tuple(
            f"Required is {what} of {required:g} {unit}; proved is "
            f"{'none' if proved is None else at_least(proved)} {unit}."
            for what, required, proved, unit in (
                ("a controller period", self.period, certificate.period, "s"),
                ("a decay rate", self.min_rate, certificate.rate, "1/s"),
            )
            if required is not None and (proved is None or proved < required)
        )
