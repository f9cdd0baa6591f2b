"""Which pictures can be written; asked before any work is done, so without Matplotlib."""

from __future__ import annotations

from pathlib import Path

from skillctl.errors import UsageError, printable

FORMATS = ("png", "svg", "pdf")


def require_format(path: Path) -> str:
    """Return the format of a picture, ``png``, ``svg`` or ``pdf``, which its suffix decides.

    Raises:
        UsageError: Another suffix, or none.
    """
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMATS:
        listed = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(
            f"{printable(str(path))}: the suffix of a picture says its format; expected one of {listed}.",
            hint=f"For example: --plot {printable(path.stem or 'skill')}.png",
        )
    return form
