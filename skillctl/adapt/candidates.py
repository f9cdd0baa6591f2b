"""Which skills of a store can help with a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.adapt.weights import most_helpful
from skillctl.errors import ArtifactError, FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import ActingSkill
from skillctl.model.space import Space
from skillctl.store import Lock, Registry, existing_store
from skillctl.store.errors import NotLockedError
from skillctl.store.source import Source, open_skill

MOST_PARTS = 5  # each more makes a common proof harder


def require_same_space(sources: Sequence[Source], demonstrations: DemonstrationSet) -> None:
    """Raise UsageError unless demonstrations have the dimension, unit and frame of the skills."""
    given, space = demonstrations.space, sources[0].skill.space
    if given.dimension != space.dimension:
        raise UsageError(
            f"merge: the demonstrations have {given.dimension} dimensions ({', '.join(given.names)}), "
            f"{sources[0].name} has {space.dimension} ({', '.join(space.names)}).",
            hint="Fit to demonstrations with the same columns as the skills'.",
        )
    for what in ("unit", "frame"):
        found, expected = getattr(given, what), getattr(space, what)
        if found != expected:
            raise UsageError(
                f"merge: {what} of the demonstrations: {found}; of {sources[0].name}: {expected}.",
                hint="Fit to demonstrations in the same units and frame as the skills'.",
            )


@dataclass(frozen=True, eq=False)
class Candidates:
    """Skills that may take part in a merger.

    Attributes:
        helpful: The two to ``MOST_PARTS`` that move along with the task.
        digests: Of all skills in the state space of the task.
        notes: A sentence for each skill that could not be read.
    """

    helpful: tuple[Source, ...]
    digests: tuple[str, ...]
    notes: tuple[str, ...] = ()


def candidates_from_store(
    store: str | Path | None,
    demonstrations: DemonstrationSet,
    lock: Lock | None = None,
    *,
    but: str | None = None,
) -> Candidates:
    """Return the newest version of each skill of the store that helps with a task; combined skills do not.

    Args:
        store: Its directory; default as on the command line.
        demonstrations: Of the task.
        lock: Consider only the skills and the versions that it names.
        but: A name to leave out: that of the result, since otherwise each run would build on the last.

    Raises:
        UsageError: The store has fewer than two skills in the state space of the demonstrations.
        FitError: No skill moves along with them.
    """
    root, space = existing_store(store), demonstrations.space
    readable, notes = newest_of_store(root, lock, but=but)
    sources = [s for s in readable if isinstance(s.skill, ActingSkill) and _alike(s.skill.space, space)]
    if len(sources) < 2:
        raise UsageError(
            f"the store {root} has {len(sources)} skills with coordinates "
            f"{', '.join(space.names)} in {space.unit}, frame {space.frame}; at least two are needed.",
            hint="Learn more skills, or name another store with --store.",
        )
    digests = tuple(source.artifact.digest for source in sources)
    return Candidates(_helpful(sources, demonstrations), digests, notes)


def newest_of_store(
    root: Path, lock: Lock | None = None, *, but: str | None = None
) -> tuple[list[Source], tuple[str, ...]]:
    """Return the newest version of each skill of a store, and a sentence for each that cannot be read.

    Args:
        root: Its directory.
        lock: Only the skills and the versions that it names.
        but: A name to leave out.
    """
    registry = Registry(root)
    sources: list[Source] = []
    notes: list[str] = []
    for name in registry.names():
        if name == but or (lock is not None and not lock.names(name)):
            continue
        try:
            sources.append(open_skill(name, registry.root, lock))
        except NotLockedError:
            raise
        except ArtifactError as error:
            notes.append(f"not considered: {error}")
    return sources, tuple(notes)


def _alike(space: Space, other: Space) -> bool:
    """Return whether states of two spaces are alike; a characteristic length can be changed."""
    return all(getattr(space, what) == getattr(other, what) for what in ("kind", "names", "unit", "frame"))


def _helpful(sources: Sequence[Source], demonstrations: DemonstrationSet) -> tuple[Source, ...]:
    """Return the skills that help when they act together; if one alone helps, the next best joins it."""
    parts = [source.skill for source in sources if isinstance(source.skill, ActingSkill)]
    chosen = most_helpful(parts, demonstrations, MOST_PARTS)
    if not chosen:
        raise FitError(
            "no skill of the store moves along with the demonstrations.", hint="Learn the task from them."
        )
    if len(chosen) == 1:
        others = [i for i in range(len(parts)) if i not in chosen]
        second = most_helpful([parts[i] for i in others], demonstrations, 1) or (0,)
        chosen = (*chosen, others[second[0]])
    return tuple(sources[i] for i in sorted(chosen))
