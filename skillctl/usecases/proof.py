"""No skill is written without a proof."""

from __future__ import annotations

from skillctl.errors import FitError
from skillctl.stability.report import Certificate

LEARN_AGAIN = "Try --preset quality, another --seed, or fewer --components."
CHECK_PARTS = "`skillctl verify-stability SKILL…` says which skill is not proved; learn that one again."


def require_stable(certificate: Certificate, hint: str = CHECK_PARTS) -> None:
    """Raise FitError unless the certificate says ``stable``: nothing unproved is ever written."""
    if certificate.verdict != "stable":
        reason = certificate.failures[0] if certificate.failures else "no proof was found."
        raise FitError(
            f"the skill could not be proved stable, so nothing was written: {reason}",
            hint=hint,
        )
