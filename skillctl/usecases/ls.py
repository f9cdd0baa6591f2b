"""What is in the store."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.store import Registry, locate_store


@dataclass(frozen=True)
class StoredSkill:
    """One name of the store.

    Attributes:
        name: Of the skill.
        versions: Its version numbers, rising.
        path: File of the newest one.
    """

    name: str
    versions: tuple[int, ...]
    path: Path


@dataclass(frozen=True)
class StoreReport:
    """Which skills a store holds.

    Attributes:
        store: Its directory, which need not exist.
        skills: By name.
    """

    store: Path
    skills: tuple[StoredSkill, ...]


def list_skills(store: Path | None = None) -> StoreReport:
    """Return the names and versions in the store, without opening a single skill.

    Raises:
        StoreError: The directory cannot be read.
    """
    registry = Registry(locate_store(store))
    versions = {name: registry.versions(name) for name in registry.names()}
    skills = [
        StoredSkill(name, numbers, registry.path_of(name, numbers[-1])) for name, numbers in versions.items()
    ]
    return StoreReport(registry.root, tuple(skills))
