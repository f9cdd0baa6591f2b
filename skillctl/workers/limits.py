"""What a call in a child may take, and how the operating system is told."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """What one call in a child may take. The child also writes no files and dumps no core.

    The parent holds the child to the time; the rest holds where the system knows such limits.

    Attributes:
        seconds: Until the answer, including the start of the child before its first call, [s].
        memory: Address space of the child, [bytes]; None for any.
        numbers: Size of all arrays in an answer, as float64, [bytes].
    """

    seconds: float
    memory: int | None = None
    numbers: int = 0

    def restrict(self) -> None:
        """Limit this process, the child, for good."""
        with contextlib.suppress(ImportError):  # not on Windows
            import resource

            _lower(resource.RLIMIT_FSIZE, 0)
            _lower(resource.RLIMIT_CORE, 0)
            if self.memory is not None:
                _lower(resource.RLIMIT_AS, self.memory)

    def grant_time(self) -> None:
        """Limit the CPU time until the next call: a parent that was killed can stop nothing any more."""
        with contextlib.suppress(ImportError):
            import resource

            _lower(resource.RLIMIT_CPU, int(time.process_time() + self.seconds) + 1)


def _lower(what: int, most: int) -> None:
    """Set a soft limit, as far as the hard one allows."""
    import resource

    hard = resource.getrlimit(what)[1]
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    with contextlib.suppress(ValueError, OSError):  # some systems know a limit, but refuse to set it
        resource.setrlimit(what, (allowed, hard))
