"""Bullet's window: opened only where it can be, and slow enough to be watched."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from skillctl.errors import NotFoundError, UsageError
from skillctl.simulation.bullet import load_bullet

PROBE = "import sys; sys.path[:] = sys.argv[1:]; import pybullet as p; p.disconnect(p.connect(p.GUI))"
PROBE_TIME = 120.0  # [s]: software rendering starts slowly
HINT = "Leave --gui out; --picture and --video need no display."


def require_window() -> None:
    """Return if a window can be opened here.

    Where it cannot, Bullet's C code ends the process without an exception. So another process tries first.

    Raises:
        NotFoundError: There is no display, or PyBullet is not installed.
        UsageError: There is one, but no window opens on it.
    """
    load_bullet()
    display = os.environ.get("DISPLAY", "")
    if sys.platform.startswith("linux") and not display:
        raise NotFoundError("there is no display to open a window on (DISPLAY is not set).", hint=HINT)
    command = [sys.executable, "-I", "-c", PROBE, *sys.path]
    try:
        ended = subprocess.run(command, capture_output=True, timeout=PROBE_TIME, check=False).returncode
    except subprocess.TimeoutExpired:
        raise UsageError(f"no window opens on {display!r} within {PROBE_TIME:g} s.", hint=HINT) from None
    if ended:
        how = signal.Signals(-ended).name if ended < 0 else f"status {ended}"
        raise NotFoundError(
            f"no window can be opened on the display {display!r} (Bullet gives up with {how}).", hint=HINT
        )


class Pace:
    """Holds a simulation back to real time."""

    def __init__(self) -> None:
        self._began = time.perf_counter()

    def wait(self, simulated: float) -> None:
        """Return when this much time [s] has passed since the beginning."""
        ahead = simulated - (time.perf_counter() - self._began)
        if ahead > 0:
            time.sleep(ahead)
