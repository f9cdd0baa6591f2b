"""Skills made from skills: what a child takes over from its parents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.model.skill import Skill
from skillctl.store import (
    Artifact,
    DemonstrationReport,
    InputRecord,
    Lock,
    Operation,
    ParentRecord,
    current_provenance,
)
from skillctl.store.source import Source, open_skill


@dataclass(frozen=True)
class PartSummary:
    """One skill that went into another.

    Attributes:
        skill, digest: How it was named and what it is.
        share: Its weight (merge) or prior (combine); all sum to one.
        n_components: Of all its leaves together.
    """

    skill: str
    digest: str
    share: float
    n_components: int


def open_parts(
    references: Sequence[str | Path], store: str | Path | None, lock: Lock | None = None
) -> list[Source]:
    """Return the skills that the references name, if the lock allows them."""
    return [open_skill(reference, store, lock) for reference in references]


def parents_of(sources: Sequence[Source]) -> list[ParentRecord]:
    """Return what a child records about its parents."""
    return [source.as_parent(f"part {number}") for number, source in enumerate(sources, start=1)]


def summaries(sources: Sequence[Source], shares: Sequence[float]) -> tuple[PartSummary, ...]:
    """Return one summary per parent."""
    return tuple(
        PartSummary(source.name, source.artifact.digest, float(share), source.skill.n_components)
        for source, share in zip(sources, shares, strict=True)
    )


def child_artifact(
    child: Skill,
    sources: Sequence[Source],
    operation: Operation,
    reports: Sequence[DemonstrationReport],
    inputs: Sequence[InputRecord] = (),
) -> Artifact:
    """Return the artifact of a skill made from others.

    Each leaf takes its demonstrations with it, moved as the leaf was moved on its way into the child.

    Args:
        child: Its leaves are those of the parents, in the same order.
        sources: The parents.
        operation: What made it.
        reports: On the demonstrations.
        inputs: Files that were read besides them.
    """
    leaves = [leaf for source in sources for leaf in source.skill.leaves]
    taught = [motions for source in sources for motions in source.artifact.demonstrations]
    demonstrations = tuple(
        None if motions is None else motions.translated(moved.attractor - leaf.attractor)
        for leaf, motions, moved in zip(leaves, taught, child.leaves, strict=True)
    )
    provenance = current_provenance(inputs=inputs, parents=parents_of(sources))
    return Artifact(child, demonstrations, operation, provenance, tuple(reports))


def draw_family(
    name: str, child: Artifact, parents: Sequence[Source], shares: Sequence[float], plot: Path
) -> None:
    """Draw a child beside its parents; see ``skillctl.usecases.pictures.picture_family``."""
    from skillctl.usecases.pictures import picture_family  # late: only pictures need Matplotlib

    picture_family(name, child, parents, shares, plot)
