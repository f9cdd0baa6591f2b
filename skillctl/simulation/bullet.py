"""The only access to PyBullet, which is imported late; its C code cannot write to standard output."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from skillctl.errors import NotFoundError


def load_bullet() -> Any:
    """Return the ``pybullet`` module.

    Raises:
        NotFoundError: PyBullet is not installed, or its binary does not load.
    """
    try:
        with silenced(2):  # the build date is printed to stderr on import
            import pybullet
    except ImportError as error:
        reason = (
            "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be loaded ({error})"
        )
        raise NotFoundError(
            f"PyBullet {reason}; only 'simulate' needs it.",
            hint="Install it: pip install pybullet. Wheels are for Python 3.10 and 3.11 on Linux x86_64; "
            "elsewhere this builds it, which needs a C++ compiler and some minutes.",
        ) from error
    return pybullet


class World:
    """A Bullet world: the functions of PyBullet, bound to this world, and its constants.

    Attributes:
        client: PyBullet's number of the world.
    """

    def __init__(self, *, gui: bool = False) -> None:
        """Args: gui: show the world in a window (see ``gui``)."""
        self._bullet = bullet = load_bullet()
        self.client = bullet.connect(bullet.GUI if gui else bullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        """Return a function or constant of PyBullet, and keep it as an attribute of this object."""
        attribute = getattr(self._bullet, name)
        if callable(attribute):
            attribute = partial(attribute, physicsClientId=self.client)
        setattr(self, name, attribute)
        return attribute


@contextmanager
def silenced(descriptor: int, into: int | None = None) -> Iterator[None]:
    """Discard all that is written to a file descriptor (1 or 2) within the block, by C code, too.

    With ``into``, write it to that descriptor instead. Replacing ``sys.stdout`` would not affect C code. C
    has its own buffer, which is flushed before the descriptor is restored, or its text would appear later.
    """
    _flush()
    try:
        saved = os.dup(descriptor)
    except OSError:  # it is closed, so nothing has to be protected
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY) if into is None else os.dup(into)
    try:
        os.dup2(sink, descriptor)
        yield
    finally:
        _flush()
        os.dup2(saved, descriptor)
        os.close(sink)
        os.close(saved)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # pythonw and daemons have none
            stream.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
