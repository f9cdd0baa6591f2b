"""Files of a user, opened without waiting."""

from __future__ import annotations

import os
import select
import stat
import time
from pathlib import Path
from typing import BinaryIO

from skillctl.errors import InputDataError, printable

PATIENCE = 60.0  # [s], for what somebody may have to type before it comes out of a pipe


def open_regular(path: Path) -> BinaryIO:
    """Return a regular file, opened to be read; of a pipe or a device the first byte may never come.

    Raises:
        InputDataError: It is a directory, a pipe or a device.
        OSError: It cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not is_regular(descriptor):
        os.close(descriptor)
        raise InputDataError(
            f"{printable(str(path))}: is not a regular file.", hint="Copy what it holds into a file."
        )
    return os.fdopen(descriptor, "rb")


def is_regular(descriptor: int) -> bool:
    """Tell whether an open file is regular and can be read now; some of /proc are not, and say they are."""
    return stat.S_ISREG(os.fstat(descriptor).st_mode) and _comes(descriptor, 0.0)


def read_from_pipe_or_file(path: Path, limit: int) -> bytes:
    """Return up to ``limit`` bytes of a file, or of a pipe, which may come late, but not for ever.

    Raises:
        InputDataError: They have not come in time.
        OSError: It cannot be opened or read.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    latest, data = time.monotonic() + PATIENCE, b""
    try:
        while len(data) < limit and _comes(descriptor, latest - time.monotonic()):
            if not (piece := os.read(descriptor, limit - len(data))):
                return data
            data += piece
    finally:
        os.close(descriptor)
    if len(data) < limit:
        raise InputDataError(
            f"{printable(str(path))}: nothing came out of it in {PATIENCE:g} s.", hint="Name a file."
        )
    return data


def _comes(descriptor: int, seconds: float) -> bool:
    """Tell whether reading will not wait, at the latest after some time."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(max(0.0, 1e3 * seconds)))
