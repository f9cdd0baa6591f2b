"""What a user may require to be proved of a skill."""

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
    """What has to be proved.

    Attributes:
        scope: ``global``: convergence from everywhere; ``local``: at least from around every attractor.
        period: Every step of a controller with this period must contract, too, [s]; None asks for none.
        min_rate: The decay rate must be at least this, [1/s]; None asks for any.
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
        """Return whether a certificate is proved of as many motions as is required."""
        return certificate.scope in ("global", self.scope)

    def unmet_by(self, certificate: Certificate) -> tuple[str, ...]:
        """Return what a certificate does not prove of what is required, in sentences."""
        if not self.reached_by(certificate):
            return (f"Required is a {self.scope} proof; proved is {certificate.scope}.",)
        sentences = []
        if self.period is not None and (certificate.period is None or certificate.period < self.period):
            sentences.append(
                f"Required is a controller period of {self.period:g} s; proved is "
                f"{_told(certificate.period)} s."
            )
        if self.min_rate is not None and (certificate.rate is None or certificate.rate < self.min_rate):
            sentences.append(
                f"Required is a decay rate of {self.min_rate:g} 1/s; proved is {_told(certificate.rate)} 1/s."
            )
        return tuple(sentences)


def _told(value: float | None) -> str:
    return "none" if value is None else at_least(value)
