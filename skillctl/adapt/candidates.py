"""Which skills of a store can help with a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.adapt.weights import most_helpful
from skillctl.errors import ArtifactError, FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import ActingSkill
from skillctl.store import Lock, Registry, locate_store
from skillctl.store.errors import NotLockedError
from skillctl.store.source import Source, open_skill

MOST_PARTS = 5  # each more makes a common proof harder


def require_same_space(sources: Sequence[Source], shown: DemonstrationSet) -> None:
    """Raise UsageError unless demonstrations mean by their numbers what the skills do."""
    space = sources[0].skill.space
    if shown.dimension != space.dimension:
        raise UsageError(
            f"merge: the demonstrations have {shown.dimension} dimensions ({', '.join(shown.space.names)}), "
            f"{sources[0].name} has {space.dimension} ({', '.join(space.names)}).",
            hint="Fit to demonstrations with the same columns as the skills'.",
        )
    for what in ("unit", "frame"):
        found, expected = getattr(shown.space, what), getattr(space, what)
        if found != expected:
            raise UsageError(
                f"merge: {what} of the demonstrations: {found}; of {sources[0].name}: {expected}.",
                hint="Fit to demonstrations in the same units and frame as the skills'.",
            )


@dataclass(frozen=True, eq=False)
class Candidates:
    """Skills of a store.

    Attributes:
        helpful: The two to ``MOST_PARTS`` that move along with the task.
        digests: Of all that have the state space of the task.
        notes: Which could not be read.
    """

    helpful: tuple[Source, ...]
    digests: tuple[str, ...]
    notes: tuple[str, ...]


def candidates_from_store(
    store: str | Path | None, shown: DemonstrationSet, lock: Lock | None = None, *, but: str | None = None
) -> Candidates:
    """Return the newest version of each skill of the store that helps with a task.

    Under a lock, the version that it names of each skill that it names. Combined skills are none.

    Args:
        store: Its directory; default as on the command line.
        shown: Demonstrations of the task.
        lock: Allow only skills that it names.
        but: A name that is not considered: the result's own, or each run would build on the last.

    Raises:
        UsageError: The store has fewer than two skills in the state space of the demonstrations.
        FitError: None moves along with them.
    """
    registry = Registry(locate_store(store))
    sources: list[Source] = []
    notes: list[str] = []
    for name in registry.names():
        if name == but or (lock is not None and not lock.names(name)):
            continue
        try:
            source = open_skill(name, registry.root, lock)
        except NotLockedError:
            raise
        except ArtifactError as error:
            notes.append(f"not considered: {error}")
            continue
        if isinstance(source.skill, ActingSkill) and source.skill.space == shown.space:
            sources.append(source)
    if len(sources) < 2:
        raise UsageError(
            f"the store {registry.root} has {len(sources)} skills with coordinates "
            f"{', '.join(shown.space.names)} in {shown.space.unit}, frame {shown.space.frame}; at least two "
            "are needed.",
            hint="Learn more skills, or name another store with --store.",
        )
    digests = tuple(source.artifact.digest for source in sources)
    return Candidates(_helpful(sources, shown), digests, tuple(notes))


def _helpful(sources: Sequence[Source], shown: DemonstrationSet) -> tuple[Source, ...]:
    """Return those that help when they act together; one that helps alone gets the next best for company."""
    parts = [source.skill for source in sources if isinstance(source.skill, ActingSkill)]
    chosen = most_helpful(parts, shown, MOST_PARTS)
    if not chosen:
        raise FitError(
            "no skill of the store moves along with the demonstrations.", hint="Learn the task from them."
        )
    if len(chosen) == 1:
        others = [i for i in range(len(parts)) if i not in chosen]
        second = most_helpful([parts[i] for i in others], shown, 1) or (0,)
        chosen = (*chosen, others[second[0]])
    return tuple(sources[i] for i in sorted(chosen))
