"""Limits of a call in a child process, which the operating system enforces."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """What one call in a child may take. The child also writes no files and dumps no core.

    The parent enforces the time; the system enforces the rest, where it knows such limits.

    Attributes:
        seconds: Until the answer, including the start of the child before its first call, [s].
        memory: Address space of the child, [bytes]; None for any.
        numbers: Size of all arrays in an answer, as float64, [bytes].
    """

    seconds: float
    memory: int | None = None
    numbers: int = 0

    def restrict(self) -> None:
        """Limit this process, the child, for one call."""
        try:
            import resource
        except ImportError:  # on Windows
            return
        # The CPU time is limited, too, because a parent that was killed enforces nothing any more.
        most = {
            resource.RLIMIT_FSIZE: 0,
            resource.RLIMIT_CORE: 0,
            resource.RLIMIT_CPU: int(time.process_time() + self.seconds) + 1,
        }
        if self.memory is not None:
            most[resource.RLIMIT_AS] = self.memory
        for kind, value in most.items():
            hard = resource.getrlimit(kind)[1]
            soft = value if hard == resource.RLIM_INFINITY else min(value, hard)
            with contextlib.suppress(ValueError, OSError):  # some systems know a limit, but refuse to set it
                resource.setrlimit(kind, (soft, hard))
