"""One BLAS thread while learning: sums are then the same on every machine, and small matrices faster."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import threadpoolctl

_lock = threading.Lock()
_holders = 0
_limits: list[Any] = []


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold every BLAS library of the process at one thread; the last holder to leave restores what was.

    The limit belongs to the process, so that holders in several threads share it. If each holder
    restored what it found, one would lift the limit under another, and the last would leave it in place.
    """
    global _holders
    with _lock:
        _let_this_thread_set_limits()
        # A second holder sets the limit again: a library may have been loaded since the first.
        _limits.append(threadpoolctl.threadpool_limits(1, user_api="blas"))
        _holders += 1
    try:
        yield
    finally:
        with _lock:
            _holders -= 1
            _let_this_thread_set_limits()
            while _limits and not _holders:  # latest first: only the earliest knows what was before all
                _limits.pop().restore_original_limits()
            _let_this_thread_set_limits()


def _let_this_thread_set_limits() -> None:
    """Let this thread set limits: threadpoolctl 3.8 ignores those of all threads but the first."""
    release = getattr(threadpoolctl.OpenBLASController, "clear_controlling_thread", None)
    if release is not None:
        release(force=True)
