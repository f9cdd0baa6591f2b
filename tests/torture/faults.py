"""Let each call to the system fail, one at a time, in each operation on a store."""

from __future__ import annotations

import builtins
import errno
import fcntl
import io
import os
import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from leftovers import Finding, require_clean, require_sweepable
from lines import OPERATIONS, PUBLISHING, Operation, prepared
from processes import Tell, content, finished, forked

from skillctl import store
from skillctl.cli.errors import describe
from skillctl.errors import SkillctlError

WRITING = {"write", "fsync", "fchmod", "link", "unlink", "replace", "mkdir"}
READING = {"open", "listdir", "scandir", "stat", "lstat", "fstat", "read"}
OTHERS: tuple[tuple[Any, str], ...] = ((fcntl, "flock"), (io, "open"), (builtins, "open"))


def failing_at(number: int) -> Callable[[], bool]:
    """Let the ``number``-th call to the system from now fail in this process; return whether it did."""
    calls = 0

    def wrapped(call: Callable[..., Any], name: str) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == number:
                code = errno.ENOSPC if name in WRITING else errno.EIO
                raise OSError(code, os.strerror(code))
            return call(*arguments, **options)

        return counted

    for module, name in (*((os, name) for name in sorted(WRITING | READING)), *OTHERS):
        setattr(module, name, wrapped(getattr(module, name), name))
    return lambda: calls >= number


def faulted(operation: Operation, registry: store.Registry, number: int, tell: Tell) -> None:
    """Do an operation in which one call fails, and tell how it ended."""
    write = os.write

    def tell_anyway(line: str) -> None:
        faulty, os.write = os.write, write
        tell(line)
        os.write = faulty

    act = operation(registry, tell_anyway)
    failed = failing_at(number)
    try:
        act()
        said = "done"
    except (SkillctlError, OSError) as error:
        said = f"refused {describe(error).message}"
    tell_anyway(said if failed() else "without fault")


def every_call(folder: Path, stride: int) -> Counter[str]:
    """Let each call (or each stride-th) of each operation fail; return how each ended."""
    seen = Counter[str]()
    for operation in OPERATIONS:
        number = 1
        while (said := _tried(folder, operation, number)) != "without fault":
            seen[f"{operation.__name__} {said}"] += 1
            number += stride
    return seen


def _tried(folder: Path, operation: Operation, number: int) -> str:
    where = f"{operation.__name__}, call {number}"
    registry, ledger = prepared(folder, root := folder / where)
    before = _state(registry)
    code, lines = finished(*forked(partial(faulted, operation, registry, number)))
    if code != 0:
        raise Finding(f"{where}: ended with {code}: {lines}")
    said = lines[-1]
    ledger.read([line for line in lines if not line.startswith(("done", "refused", "without"))])
    if said.startswith("refused"):
        _require_true(where, operation, said, before, _state(registry), root)
    require_clean(root, ledger, where)
    require_sweepable(root, ledger, content("survivor", number), where)
    return said.split()[0] if said != "without fault" else said


def _state(registry: store.Registry) -> tuple[set[int], dict[str, int]]:
    return set(registry.versions("reach")), registry.aliases("reach")


def _require_true(where: str, operation: Operation, said: str, before: Any, after: Any, root: Path) -> None:
    """Raise Finding unless what was said of an operation that failed is what happened."""
    gone = before[0] - after[0]
    lost = before[1].keys() - after[1].keys()
    if operation in PUBLISHING:
        made = {path for path in root.rglob("*.h5") if int(path.stem) > 3 or path.parents[1] != root}
        if bool(made) != ("was published" in said.lower() and "nothing was published" not in said.lower()):
            raise Finding(f"{where}: made {made}, and said {said!r}")
    elif operation.__name__.startswith(("remove", "collect")):
        told = said.partition("Removed before that: ")[2]
        named = set(re.findall(r"reach@([a-z0-9]+)", told))
        if named != {*map(str, gone), *lost} or (named and "Nothing was removed" in said):
            raise Finding(f"{where}: {gone} and {lost} are gone, and it said {said!r}")
    elif gone or (before != after and operation.__name__ not in ("tag", "untag")):
        raise Finding(f"{where}: changed {before} to {after}, and said {said!r}")
