"""Files of a user, opened without waiting."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from skillctl.errors import InputDataError, printable


def open_regular(path: Path) -> BinaryIO:
    """Return a regular file, opened to be read; of a pipe or a device the first byte may never come.

    Raises:
        InputDataError: It is a directory, a pipe or a device.
        OSError: It cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputDataError(
            f"{printable(str(path))}: is not a regular file.", hint="Copy what it holds into a file."
        )
    return os.fdopen(descriptor, "rb")
