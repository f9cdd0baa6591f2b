"""Which version of a skill a reference means."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from skillctl.errors import NotFoundError, UsageError, did_you_mean
from skillctl.store.references import Reference

DigestOf = Callable[[int], str | None]


def select(
    reference: Reference, numbers: tuple[int, ...], aliases: Callable[[], Mapping[str, int]], digest: DigestOf
) -> int:
    """Return the version that a reference means.

    Args:
        reference: Name and selector.
        numbers: Versions that exist, rising, at least one.
        aliases: Reads the aliases; called only if the selector is one.
        digest: Returns the content digest of a version, None if it cannot be read.

    Raises:
        NotFoundError: No such version or alias.
        UsageError: The beginning of more than one digest.
    """
    selector = reference.selector
    if selector == "latest":
        return numbers[-1]
    if isinstance(selector, int):
        return _numbered(reference.name, selector, numbers)
    if selector.startswith("sha256:"):
        return _with_digest(reference.name, selector, numbers, digest)
    return _with_alias(reference.name, selector, numbers, aliases())


def _numbered(name: str, version: int, numbers: tuple[int, ...]) -> int:
    if version in numbers:
        return version
    # Numbers are given without gaps, so one that is missing below another was there once.
    removed = ": it was removed" if version < numbers[-1] else ""
    raise NotFoundError(
        f"{name} has no version {version}{removed}.",
        hint=f"It has {ranges(numbers)}; `{name}` alone names the newest.",
    )


def _with_alias(name: str, alias: str, numbers: tuple[int, ...], aliases: Mapping[str, int]) -> int:
    if alias not in aliases:
        raise unknown_alias(name, alias, aliases)
    if aliases[alias] not in numbers:
        raise NotFoundError(
            f"{name}@{alias} is version {aliases[alias]}, which does not exist.",
            hint=f"It has {ranges(numbers)}; `skillctl tag {name}@N {alias}` moves the alias.",
        )
    return aliases[alias]


def unknown_alias(name: str, alias: str, aliases: Iterable[str]) -> NotFoundError:
    """Return the error for an alias that a skill does not have."""
    known = list(aliases)
    hint = (
        did_you_mean(alias, {word: f"{name}@{word}" for word in known}, cutoff=0.5)
        or what_there_is(known)
        or f"It has no aliases yet; `skillctl tag {name}@N {alias}` makes one."
    )
    return NotFoundError(f"{name} has no alias {alias}.", hint=hint)


def what_there_is(known: Sequence[str]) -> str:
    """Return ``It has …`` with the first few of the known words, or nothing."""
    return f"It has {', '.join(known[:8])}{' …' if len(known) > 8 else ''}." if known else ""


def _with_digest(name: str, beginning: str, numbers: tuple[int, ...], digest_of: DigestOf) -> int:
    found: dict[int, str] = {}
    for number in reversed(numbers):
        digest = digest_of(number) or ""
        if digest == beginning:
            return number
        if digest.startswith(beginning):
            found[number] = digest
    if not found:
        raise NotFoundError(
            f"no version of {name} has a content digest beginning {beginning}.",
            hint=f"It has {ranges(numbers)}; `skillctl ls {name}` shows their digests.",
        )
    if len(set(found.values())) > 1:
        raise UsageError(
            f"{len(found)} versions of {name} have a content digest beginning {beginning}.",
            hint=f"Give more digits: {', '.join(found.values())}.",
        )
    return next(iter(found))


def ranges(numbers: tuple[int, ...]) -> str:
    """Return ``version 1``, ``versions 1 to 7`` or ``versions 1 to 7 (5 of them)``."""
    if len(numbers) == 1:
        return f"version {numbers[0]}"
    gaps = f" ({len(numbers)} of them)" if numbers[-1] - numbers[0] >= len(numbers) else ""
    return f"versions {numbers[0]} to {numbers[-1]}{gaps}"
