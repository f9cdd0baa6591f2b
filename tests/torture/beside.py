"""Read a store for as long as others write to it: every answer is of one moment, and none is an error."""

from __future__ import annotations

import time
from collections import Counter
from functools import partial
from pathlib import Path

from leftovers import Finding, Ledger, require_clean
from processes import Tell, content, finished, forked

from skillctl import store
from skillctl.errors import NotFoundError
from skillctl.store.lockfile import read_lock
from skillctl.usecases import versions
from skillctl.usecases.lock import lock
from skillctl.usecases.ls import list_skills


def _publish(root: Path, index: int) -> None:
    store.Registry(root).publish("reach", content("beside", index))


def _tag(root: Path, _: int) -> None:
    versions.tag("reach", "release", store=root)


def _untag(root: Path, _: int) -> None:
    versions.untag("reach", "release", store=root)


def _collect(root: Path, _: int) -> None:
    versions.collect(keep_last=2, keep_tagged=True, store=root)


def _remove(root: Path, _: int) -> None:
    versions.remove(["reach@latest"], force=True, store=root)


def _lock(root: Path, _: int) -> None:
    lock(["reach"], path=root / "skillctl.lock", store=root)


def _ls(root: Path, _: int) -> None:
    for skill in list_skills(root, check=True).skills:
        for entry in skill.entries:
            if entry.problem:
                raise Finding(f"{skill.name}@{entry.version}: {entry.problem}")


def _read(root: Path, _: int) -> None:
    read_lock(root / "skillctl.lock")
    store.read_skill(store.Registry(root).locate("reach").path)


WORKS = (_publish, _publish, _tag, _untag, _collect, _remove, _lock, _ls, _ls, _read)


def _for_a_while(work, root: Path, seconds: float, tell: Tell) -> None:
    """Work again and again; what others have removed meanwhile may be missing."""
    until, done, missing = time.monotonic() + seconds, 0, 0
    while time.monotonic() < until:
        try:
            work(root, done + missing)
            done += 1
        except NotFoundError:
            missing += 1
    tell(f"{work.__name__} {done} {missing}")


def all_beside(folder: Path, seconds: float) -> Counter[str]:
    """Let processes publish, tag, untag, collect, remove, lock, list and read in one store, and count."""
    root, seen = folder / "skills", Counter[str]()
    for index in range(3):
        store.Registry(root).publish("reach", content("first", index))
    for child, told in [forked(partial(_for_a_while, work, root, seconds)) for work in WORKS]:
        code, lines = finished(child, told)
        if code != 0:
            raise Finding(f"one ended with {code}: {lines}")
        name, done, missing = lines[-1].split()
        seen[name.removeprefix("_")] += int(done)
        seen[f"{name.removeprefix('_')} in vain"] += int(missing)
    ledger = Ledger()
    ledger.see(root)
    ledger.maybe_release = {0, *ledger.there}
    if require_clean(root, ledger, "at the end"):
        raise Finding("temporaries were left")
    return seen
