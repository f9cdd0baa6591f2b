"""Stop an operation on a store before each line of its program."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from leftovers import Finding, Ledger, require_clean, require_sweepable
from processes import Tell, content, finished, forked, without_unnamed_files

from skillctl import store
from skillctl.errors import Terminated
from skillctl.usecases.lock import lock
from skillctl.usecases.versions import collect

# Where the store is written.
TRACED = ("registry.py", "folder.py", "local.py", "files.py", "signing.py")

# What an operation prepares, and then does.
Operation = Callable[[store.Registry, Tell], Callable[[], object]]


def publish(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    data = content("lines", 0)
    tell(f"publishing {store.digest_of(data)}")

    def act() -> None:
        made = registry.publish("reach", data)
        sys.settrace(None)
        tell(f"published {made.version} {made.digest}")

    return act


def publish_named(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    without_unnamed_files()
    return publish(registry, tell)


def publish_first(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    """Publish into a store that is not there yet."""
    data = content("lines", 0)
    tell(f"publishing {store.digest_of(data)}")
    return lambda: store.Registry(registry.root / "deeper" / "skills").publish("reach", data)


def tag(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    tell("tagging release 3")
    return lambda: registry.tag("reach", 3, "release")


def untag(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    tell("tagging release 0")
    return lambda: registry.untag("reach", "release")


def remove_newest(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    tell("removing 3")
    return lambda: registry.remove("reach", [3])


def remove_tagged(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    tell("removing 2")
    return lambda: registry.remove("reach", [2])


def collect_tagged_kept(registry: store.Registry, tell: Tell) -> Callable[[], object]:
    tell("removing 1")
    return lambda: collect(["reach"], keep_last=1, keep_tagged=True, store=registry.root)


def lock_newest(registry: store.Registry, _: Tell) -> Callable[[], object]:
    return lambda: lock(["reach"], path=registry.root / "skillctl.lock", store=registry.root)


def sign(registry: store.Registry, _: Tell) -> Callable[[], object]:
    located, signature = signature_of(registry, 1)
    return lambda: store.add_signature(located, signature)


PUBLISHING: tuple[Operation, ...] = (publish, publish_named, publish_first)
COLLECTING: tuple[Operation, ...] = (collect_tagged_kept, lock_newest)
OPERATIONS: tuple[Operation, ...] = (*PUBLISHING, tag, untag, remove_newest, remove_tagged, sign, *COLLECTING)


def signature_of(registry: store.Registry, version: int) -> tuple[store.Located, store.Signature]:
    """Return a version, and a signature of it; that nobody's key made it does not matter here."""
    path = registry.path_of("reach", version)
    digest = store.digest_of(path.read_bytes())
    return store.Located(path), store.Signature(f"ed25519:{'0' * 64}", digest, "0" * 128)


def prepared(folder: Path, root: Path) -> tuple[store.Registry, Ledger]:
    """Return a store of three versions, the second of them tagged, the last two signed."""
    registry, ledger = store.Registry(folder / "prepared"), Ledger()
    if not registry.names():
        for index in range(3):
            registry.publish("reach", content("prepared", index))
        registry.tag("reach", 2, "release")
        for version in (2, 3):
            store.add_signature(*signature_of(registry, version))
    shutil.copytree(registry.root, root)
    ledger.see(root)
    ledger.read(["tagged release 2"])
    ledger.signed = {2, 3}
    return store.Registry(root), ledger


def before_line(number: int, act: Callable[[], None]) -> None:
    """Call ``act`` before the ``number``-th line from now of the store's program."""
    lines = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal lines
        path = Path(frame.f_code.co_filename)
        if path.name not in TRACED or path.parent.name != "store":
            return None
        if event == "line":
            lines += 1
            if lines == number:
                sys.settrace(None)
                act()
        return trace

    sys.settrace(trace)


def struck(operation: Operation, registry: store.Registry, line: int, number: int, tell: Tell) -> None:
    """Do an operation, and send this process a signal before one of its lines."""

    def terminate(*_: object) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, terminate)
    act = operation(registry, tell)
    before_line(line, lambda: os.kill(os.getpid(), number))
    act()
    sys.settrace(None)


def every_line(folder: Path, number: int, stride: int) -> Counter[str]:
    """Stop each operation before each line (or each stride-th) until it gets through; return how often."""
    seen = Counter[str]()
    for operation in OPERATIONS:
        line = 1
        while stopped(folder, operation, line, number, seen):
            line += stride
    return seen


def stopped(folder: Path, operation: Operation, line: int, number: int, seen: Counter[str]) -> bool:
    """Do an operation in a new store, stop it before a line, look around; return False if it ended."""
    where = f"{operation.__name__}, line {line}"
    registry, ledger = prepared(folder, root := folder / where)
    code, lines = finished(*forked(partial(struck, operation, registry, line, number)))
    if code not in (0, 130, -signal.SIGKILL):
        raise Finding(f"{where}: ended with {code}: {lines}")
    ledger.read(lines)
    seen["temporaries left"] += require_clean(root, ledger, where)
    if code == 130 and operation in PUBLISHING:
        require_told(lines, root, where)
    if code == 130 and any(root.rglob(".publishing-*")):
        seen["temporaries left by an interrupt"] += 1
    require_sweepable(root, ledger, content("survivor", line), where)
    seen[operation.__name__] += code != 0
    return code != 0


def require_told(lines: list[str], root: Path, where: str) -> None:
    """An interrupted command says which version was published; if it names none, none was."""
    digest, said = lines[0].split()[1], lines[-1]
    found = [path.stem for path in root.rglob("*.h5") if store.digest_of(path.read_bytes()) == digest]
    named = re.findall(r"reach@(\d+) was published", said)
    if named != found:
        raise Finding(f"{where}: published as {found}, but the command said {said!r}")
