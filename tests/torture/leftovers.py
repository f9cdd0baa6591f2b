"""What must be true of a store, whatever happened to those who wrote to it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skillctl import store
from skillctl.usecases.ls import list_skills

HOURS = 2 * 3600.0  # [s]; a temporary file of that age belongs to nobody
VERSION = re.compile(r"[1-9][0-9]*\.h5")
TEMPORARY = re.compile(r"\.publishing-[0-9a-f]+|\..+\.[0-9a-f]+\.tmp")
KNOWN = re.compile(r"[1-9][0-9]*\.(h5|h5\.sig|removed)|refs\.toml")


@contextmanager
def without_waiting() -> Iterator[None]:
    """Let this process not wait for the disk: it is never killed, and looks on only."""
    sync, os.fsync = os.fsync, lambda fd: None
    try:
        yield
    finally:
        os.fsync = sync


class Finding(Exception):  # noqa: N818 - what the commands of this folder look for
    """A rule of the store that was broken."""


class Ledger:
    """What writers said they had done, and what they were about to do when they stopped.

    Attributes:
        there: Content digest of each version that must be there, by number.
        given: All numbers that were ever reported.
        release: Version of the alias, 0 for none.
        signed: Versions that have signatures, for as long as they are there.
        interrupted: What was announced last and never reported.
    """

    def __init__(self) -> None:
        self.there: dict[int, str] = {}
        self.given: set[int] = set()
        self.release = 0
        self.signed: set[int] = set()
        self.interrupted = ""
        self.maybe_release: set[int] = set()
        self.maybe_gone: set[int] = set()

    def read(self, lines: list[str]) -> None:
        """Take note of complete lines; a version is reported once."""
        self.interrupted, self.maybe_release, self.maybe_gone = "", {self.release}, set()
        for line in lines:
            what, *rest = line.split()
            self.interrupted = what if what.endswith("ing") else ""
            if what == "published":
                self._add(int(rest[0]), rest[1])
            elif what == "tagging":
                self.maybe_release.add(int(rest[1]))
            elif what == "tagged":
                self.release = int(rest[1])
                self.maybe_release = {self.release}
            elif what == "removing":
                self.maybe_gone = {*map(int, rest)}
                if self.release in self.maybe_gone:
                    self.maybe_release.add(0)
            elif what == "removed":
                for version in map(int, rest):
                    self.there.pop(version, None)  # of one killed before it could report, there is none
                    if self.release == version:
                        self.release, self.maybe_release = 0, {0}
                self.maybe_gone = set()

    def _add(self, version: int, digest: str) -> None:
        if version in self.given:
            raise Finding(f"version {version} was given twice")
        self.given.add(version)
        self.there[version] = digest

    def see(self, root: Path) -> set[int]:
        """Count what is in the store now as reported; return what is new in it."""
        found = {int(path.stem): path for path in (root / "reach").glob("*.h5")}
        new = found.keys() - self.there.keys()
        for version in new:
            self._add(version, store.read_skill(found[version]).digest)
        return new


def require_clean(root: Path, ledger: Ledger, where: str = "") -> int:
    """Raise Finding unless the store is whole and as the ledger says; return how many temporaries."""
    directory, before = root / "reach", f"{where}: " if where else ""
    if not directory.exists():
        if ledger.there:
            raise Finding(f"{before}the directory is gone")
        return 0
    names = {path.name for path in directory.iterdir()}
    temporary = {name for name in names if TEMPORARY.fullmatch(name)}
    if strange := {name for name in names - temporary if not KNOWN.fullmatch(name)}:
        raise Finding(f"{before}left behind: {strange}")
    if len(temporary) > 1:
        raise Finding(f"{before}one process left {temporary}")
    for skill in list_skills(root, check=True).skills:
        for entry in skill.entries:
            if not entry.verified or entry.problem:
                raise Finding(f"{before}{skill.name}@{entry.version}: {entry.problem}")
    _require_versions(directory, ledger, before)
    _require_signatures(directory, ledger, before)
    release = store.Registry(root).aliases("reach").get("release", 0)
    if release not in ledger.maybe_release | {ledger.release}:
        raise Finding(f"{before}release is {release}, not one of {ledger.maybe_release}")
    ledger.release = release
    return len(temporary)


def _require_versions(directory: Path, ledger: Ledger, before: str) -> None:
    found = {int(path.stem): path for path in directory.iterdir() if VERSION.fullmatch(path.name)}
    for version, digest in ledger.there.items():
        if version not in found:
            if version not in ledger.maybe_gone:
                raise Finding(f"{before}version {version} was reported and is not there")
        elif store.read_skill(found[version]).digest != digest:
            raise Finding(f"{before}version {version} holds something else")
    ledger.there = {version: digest for version, digest in ledger.there.items() if version in found}
    for version in found.keys() - ledger.there.keys():
        if version in ledger.given:
            raise Finding(f"{before}version {version} was reported as removed and is there")
    if wrong := [path for path in found.values() if path.stat().st_mode & 0o777 != 0o444]:
        raise Finding(f"{before}modes of {wrong}")


def _require_signatures(directory: Path, ledger: Ledger, before: str) -> None:
    for version in ledger.signed & ledger.there.keys():
        if not store.read_signatures(store.Located(directory / f"{version}.h5")):
            raise Finding(f"{before}version {version} is there and its signature is not")


def require_sweepable(root: Path, ledger: Ledger, data: bytes, where: str = "") -> None:
    """Raise Finding unless the next writers go on, and nothing temporary is left once it is old."""
    directory, registry = root / "reach", store.Registry(root)
    highest = max((*ledger.given, *registry.versions("reach")), default=0)
    if directory.exists():
        for path in directory.iterdir():
            if TEMPORARY.fullmatch(path.name):
                old = path.lstat().st_mtime - HOURS
                os.utime(path, (old, old))
    with without_waiting():
        made = registry.publish("reach", data)
        registry.tag("reach", made.version, "next")
        registry.untag("reach", "next")
    if made.version <= highest:
        raise Finding(f"{where}: the number {made.version} was given twice")
    ledger.given.add(made.version)
    ledger.there[made.version] = made.digest
    if left := [path.name for path in directory.iterdir() if TEMPORARY.fullmatch(path.name)]:
        raise Finding(f"{where}: never swept: {left}")
    if alone := [path.name for path in directory.glob("*.sig") if not path.with_suffix("").exists()]:
        raise Finding(f"{where}: signatures of nothing: {alone}")
