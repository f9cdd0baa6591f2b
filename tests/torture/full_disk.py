"""A disk that is full from the N-th change of this process on."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from typing import Any

CHANGES = ("write", "fsync", "link", "mkdir", "rename", "replace", "open")
CREATING = os.O_CREAT | getattr(os, "O_TMPFILE", 0) & ~os.O_DIRECTORY


def fill_after(changes: int) -> None:
    """Let each call that would need space fail with ENOSPC, but for the first few; unlinking needs none."""
    left = changes

    def full(call: Callable[..., Any]) -> Callable[..., Any]:
        def refused(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            if call.__name__ != "open" or arguments[1] & CREATING:
                left -= 1
                if left < 0:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return call(*arguments, **options)

        return refused

    for name in CHANGES:
        setattr(os, name, full(getattr(os, name)))
