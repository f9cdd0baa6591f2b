"""Bullet's window, which shows the motion in real time, where one can be opened."""

from __future__ import annotations

import os
import sys
import time

from skillctl.errors import NotFoundError, UsageError
from skillctl.simulation.bullet import load_bullet
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

LIMITS = Limits(seconds=120.0)  # software rendering starts slowly
HINT = "Leave --gui out; --picture and --video need no display."


def require_window() -> None:
    """Return if a window can be opened here.

    Where none can be, Bullet's C code ends the process without an exception, so another process tries first.

    Raises:
        NotFoundError: There is no display, or PyBullet is not installed.
        UsageError: There is one, but no window opens on it.
    """
    load_bullet()
    display = os.environ.get("DISPLAY", "")
    if sys.platform.startswith("linux") and not display:
        raise NotFoundError("there is no display to open a window on (DISPLAY is not set).", hint=HINT)
    try:
        with Child(LIMITS) as child:
            child.call(open_window)
    except TimeoutError:
        raise UsageError(f"no window opens on {display!r} within {LIMITS.seconds:g} s.", hint=HINT) from None
    except (ChildDiedError, ValueError) as error:
        how = f"Bullet fails: {error}" if isinstance(error, ValueError) else f"the process that tries {error}"
        raise NotFoundError(
            f"no window can be opened on the display {display!r} ({how}).", hint=HINT
        ) from None


def open_window() -> None:
    """Open a window and close it, which may end this process."""
    bullet = load_bullet()
    bullet.disconnect(bullet.connect(bullet.GUI))


class Pace:
    """A clock that slows a simulation down to real time."""

    def __init__(self) -> None:
        self._began = time.perf_counter()

    def wait(self, simulated: float) -> None:
        """Return when this much time [s] has passed since the beginning."""
        ahead = simulated - (time.perf_counter() - self._began)
        if ahead > 0:
            time.sleep(ahead)
