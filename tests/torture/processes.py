"""Processes that write to a store, and artifacts for them to write."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from skillctl import store
from skillctl.cli.errors import describe
from skillctl.store import local, registry

TEMPLATE = Path(__file__).parents[1] / "archives" / "v1" / "seds.h5"

Tell = Callable[[str], None]


def content(writer: object, index: int) -> bytes:
    """Return an artifact that no other arguments give."""
    base = store.read_skill(TEMPLATE)
    operation = store.Operation(command="learn", results={"writer": str(writer), "index": index})
    return store.encode(replace(base, operation=operation))


def without_unnamed_files() -> None:
    """Let this process publish as on a file system that has no files without names."""
    local._open_unnamed = lambda directory: None


def forked(work: Callable[[Tell], None]) -> tuple[int, int]:
    """Do ``work`` in a process of its own; return its number, and a descriptor to read what it tells."""
    receiving, sending = os.pipe()
    child = os.fork()
    if child:
        os.close(sending)
        return child, receiving
    code = 70
    try:
        os.close(receiving)
        registry.PUBLISHED.clear()  # what the parent did is not told here
        work(lambda line: os.write(sending, f"{line}\n".encode()) and None)
        code = 0
    except KeyboardInterrupt as stop:
        os.write(sending, f"stopped {describe(stop).message}\n".encode())
        code = 130
    except Exception as error:
        os.write(sending, f"failed {error!r}\n".encode())
    finally:
        os._exit(code)


def finished(child: int, receiving: int) -> tuple[int, list[str]]:
    """Wait for a process; return its exit code (minus the signal that killed it), and what it told."""
    with os.fdopen(receiving) as told:
        lines = told.read().splitlines()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), lines
