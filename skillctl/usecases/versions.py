"""Aliases for versions, and the removal of versions that are not needed any more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from skillctl.errors import NotFoundError, SkillctlError, UsageError, printable
from skillctl.store import Reference, Registry, existing_store, parse_reference
from skillctl.store.folder import by_version
from skillctl.store.registry import Removed, has_alias


@dataclass(frozen=True)
class TagReport:
    """What an alias names now.

    Attributes:
        skill: ``name@3``; for an alias that was removed, the version that it named.
        alias: The word.
        before: What the alias named until now, if anything.
    """

    skill: str
    alias: str
    before: str | None


@dataclass(frozen=True)
class Removal:
    """One version that is removed.

    Attributes:
        skill: ``name@3``.
        path: Its file.
        aliases: The aliases that named it; they are removed with it.
    """

    skill: str
    path: Path
    aliases: tuple[str, ...]


@dataclass(frozen=True)
class RemoveReport:
    """Which versions were removed.

    Attributes:
        store: The directory.
        removed: Versions, by name and number.
        kept: How many versions of the same skills stay.
        dry_run: Nothing was removed: this is what would be.
    """

    store: Path
    removed: tuple[Removal, ...]
    kept: int
    dry_run: bool


def tag(reference: str, alias: str, *, store: Path | None = None) -> TagReport:
    """Let an alias name a version of the store.

    Raises:
        UsageError: The reference names a file, or no version can have this alias.
        NotFoundError: There is no such skill or version.
        InvalidRefsError: The skill's aliases cannot be read.
    """
    registry, parsed = Registry(existing_store(store)), _in_store(reference)
    version = registry.version_of(parsed)
    before = registry.tag(parsed.name, version, alias)
    named = None if before is None else f"{parsed.name}@{before}"
    return TagReport(f"{parsed.name}@{version}", alias, named)


def untag(name: str, alias: str, *, store: Path | None = None) -> TagReport:
    """Remove an alias; the version stays.

    Raises:
        NotFoundError: There is no such skill or alias.
        InvalidRefsError: The skill's aliases cannot be read.
    """
    version = Registry(existing_store(store)).untag(name, alias)
    return TagReport(f"{name}@{version}", alias, f"{name}@{version}")


def remove(
    references: Sequence[str],
    *,
    all_versions: bool = False,
    force: bool = False,
    dry_run: bool = False,
    store: Path | None = None,
) -> RemoveReport:
    """Remove versions from the store; their numbers are not given again.

    Args:
        references: ``name@3``, ``name@alias`` or ``name@sha256:…``; with ``all_versions`` names alone.
        all_versions: Remove every version of the names.
        force: Remove versions that have aliases, too, and the aliases with them.
        dry_run: Only say what would be removed.
        store: Where names live; default as on the command line.

    Raises:
        UsageError: A name without a version, a file, or a version that has an alias.
        NotFoundError: There is no such version; nothing is removed.
    """
    registry = Registry(existing_store(store))
    doomed: dict[str, set[int]] = {}
    for reference in references:
        parsed = _in_store(reference)
        name, version = parsed.name, registry.version_of(parsed)
        if all_versions != ("@" not in reference):
            raise UsageError(
                f"{reference}: with --all, give names without a version."
                if all_versions
                else f"{reference} does not say which version.",
                hint=f"Write {name}@{version}, or --all {name} for every version.",
            )
        doomed.setdefault(name, set()).update(registry.versions(name) if all_versions else {version})
    for name, numbers in () if force else doomed.items():
        for alias, version in registry.aliases(name).items():
            if version in numbers:
                raise has_alias(name, alias, version)
    return _remove(registry, doomed, "remove" if force else "refuse", dry_run)


def collect(
    names: Sequence[str] = (),
    *,
    keep_last: int,
    keep_tagged: bool = False,
    dry_run: bool = False,
    store: Path | None = None,
) -> RemoveReport:
    """Remove all but the newest versions of skills.

    Args:
        names: Skills; all of the store by default.
        keep_last: How many versions of each skill to keep, at least 1.
        keep_tagged: Keep versions that have an alias, too.
        dry_run: Only say what would be removed.
        store: Where names live; default as on the command line.

    Raises:
        UsageError: Fewer than one version would be kept.
        NotFoundError: There is no skill of a name.
    """
    if keep_last < 1:
        raise UsageError(
            f"--keep-last {keep_last}: at least the newest version is kept.",
            hint="`skillctl rm --all NAME` removes a skill altogether.",
        )
    registry = Registry(existing_store(store))
    for name in names:
        registry.locate(name)
    doomed = {name: set(registry.versions(name)[:-keep_last]) for name in names or registry.names()}
    return _remove(registry, doomed, "keep" if keep_tagged else "remove", dry_run)


def _in_store(reference: str) -> Reference:
    parsed = parse_reference(reference)
    if isinstance(parsed, Path):
        raise UsageError(
            f"{printable(reference)} names a file; only skills of the store have versions.",
            hint="Name it like reach@3.",
        )
    return parsed


def _remove(
    registry: Registry,
    doomed: dict[str, set[int]],
    tagged: Literal["remove", "keep", "refuse"],
    dry_run: bool,
) -> RemoveReport:
    """Remove versions, or say which would be; skills that others remove meanwhile are passed over."""
    removed: list[Removal] = []
    kept = 0
    for name, numbers in sorted(doomed.items()):
        try:
            gone = _gone(registry, name, numbers, tagged, dry_run)
            words = by_version(gone.aliases)
            removed += [
                Removal(f"{name}@{number}", registry.path_of(name, number), words.get(number, ()))
                for number in gone.versions
            ]
            kept += len(registry.versions(name)) - (len(gone.versions) if dry_run else 0)
        except NotFoundError:
            continue
        except SkillctlError as error:
            if removed and not dry_run:
                error.add(f"Removed before that: {', '.join(each.skill for each in removed)}.")
            raise
    return RemoveReport(registry.root, tuple(removed), kept, dry_run)


def _gone(
    registry: Registry,
    name: str,
    numbers: set[int],
    tagged: Literal["remove", "keep", "refuse"],
    dry_run: bool,
) -> Removed:
    """Remove versions of one skill, or find out which would be."""
    if not numbers:
        return Removed((), {})
    if not dry_run:
        return registry.remove(name, numbers, tagged=tagged)
    aliases = registry.aliases(name)
    numbers = numbers - set(aliases.values()) if tagged == "keep" else numbers
    return Removed(tuple(sorted(numbers)), {a: v for a, v in aliases.items() if v in numbers})
