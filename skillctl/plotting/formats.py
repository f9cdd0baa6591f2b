"""Checks, before any work is done and without Matplotlib, that a picture can be written."""

from __future__ import annotations

from pathlib import Path

from skillctl.errors import UsageError, printable, require_directory

FORMATS = ("png", "svg", "pdf")
MOST_PROOFS = 12  # certificates in one figure


def require_picture(path: Path) -> str:
    """Return the format of a picture, or raise UsageError or StoreError if it cannot be written there."""
    form = require_format(path)
    require_directory(path)
    return form


def require_format(path: Path) -> str:
    """Return the format of a picture, ``png``, ``svg`` or ``pdf``, which its suffix decides.

    Raises:
        UsageError: Another suffix, or none.
    """
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMATS:
        listed = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(
            f"{printable(str(path))}: the suffix of a picture decides its format; expected one of {listed}.",
            hint=f"For example: {printable(path.stem or 'skill')}.png",
        )
    return form


def require_few(skills: int) -> None:
    """Raise UsageError for more skills than one figure of certificates can show."""
    if skills > MOST_PROOFS:
        raise UsageError(
            f"plot: {skills} skills are more than one picture shows; expected at most {MOST_PROOFS}.",
            hint="Draw them in several calls.",
        )
