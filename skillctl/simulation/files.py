"""Files appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from skillctl.errors import StoreError


def write_atomically(path: Path, data: bytes) -> None:
    """Write ``data`` beside ``path``, then put it in its place.

    Raises:
        StoreError: The disk refused; ``path`` is as it was.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise StoreError(
            f"{path}: cannot be written ({error.strerror}).", hint="Check the folder and its permissions."
        ) from error
