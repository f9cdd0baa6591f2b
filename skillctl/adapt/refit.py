"""Parts without a common Lyapunov matrix: learned again from what they carry, under one for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillctl.arrays import FloatArray
from skillctl.compose.lyapunov import conflicting_parts
from skillctl.errors import FitError
from skillctl.evaluate.errors import mean_dtw, report_errors
from skillctl.learning.fit import fit, learned_metric
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill, retargeted
from skillctl.progress import Progress
from skillctl.store import DemonstrationReport
from skillctl.store.source import Source


@dataclass(frozen=True)
class Refit:
    """A leaf that was learned again under the common Lyapunov matrix.

    Attributes:
        skill: The parent it belongs to.
        leaf: Which leaf of the new skill, counted from 1.
        dtw_before, dtw_after: Mean distance of its motions to its demonstrations, in the unit of the space;
            None if a rollout diverged.
    """

    skill: str
    leaf: int
    dtw_before: float | None
    dtw_after: float | None


@dataclass(frozen=True, eq=False)
class RefittedParts:
    """Parts that share a Lyapunov matrix (d, d), and how well each leaf still does what it was taught."""

    parts: tuple[Skill, ...]
    lyapunov: FloatArray
    refits: tuple[Refit, ...]
    reports: tuple[DemonstrationReport, ...]


def conflict_of(sources: Sequence[Source]) -> str:
    """Return the names of the skills that admit no common Lyapunov matrix, as in ``a and b``."""
    group = conflicting_parts([source.skill for source in sources]) or range(len(sources))
    return " and ".join(sources[index].name for index in group)


def refit_parts(sources: Sequence[Source], progress: Progress | None = None) -> RefittedParts:
    """Learn every leaf of every part again, from its demonstrations, under one Lyapunov matrix for all.

    Raises:
        FitError: A part carries no demonstrations.
    """
    taught = _required_demonstrations(sources)
    lyapunov = learned_metric(taught)
    leaves: list[SedsSkill] = []
    refits: list[Refit] = []
    reports: list[DemonstrationReport] = []
    owners = [source for source in sources for _ in source.skill.leaves]
    for number, (source, motions) in enumerate(zip(owners, taught, strict=True)):
        if progress is not None:
            progress(f"refitting {source.name}", number, len(owners))
        old = [leaf for part in sources for leaf in part.skill.leaves][number]
        fitted = fit(motions, _options_of(source, old), lyapunov=lyapunov)
        new = replace(retargeted(fitted.skill, old.attractor), speed=old.speed)
        before, after = (report_errors(leaf, motions, number) for leaf in (old, new))
        leaves.append(new)
        refits.append(Refit(source.name, number + 1, mean_dtw(before), mean_dtw(after)))
        reports += after
    remaining = iter(leaves)
    parts = tuple(source.skill.with_leaves(lambda _: next(remaining)) for source in sources)
    return RefittedParts(parts, lyapunov, tuple(refits), tuple(reports))


def _required_demonstrations(sources: Sequence[Source]) -> list[DemonstrationSet]:
    taught: list[DemonstrationSet] = []
    for source in sources:
        for motions in source.artifact.demonstrations:
            if motions is None:
                raise FitError(
                    f"no one Lyapunov matrix proves {conflict_of(sources)}, and {source.name} carries no "
                    "demonstrations from which it could be learned again.",
                    hint="Learn the skills again with `skillctl learn --metric euclidean`: those always fit "
                    "together.",
                )
            taught.append(motions)
    return taught


def _options_of(source: Source, leaf: SedsSkill) -> LearnOptions:
    """Return how the leaf was learned, as far as its artifact says."""
    recorded: dict[str, Any] = {}
    if source.artifact.operation.command == "learn":
        options = source.artifact.operation.options
        recorded = {key: options[key] for key in ("objective", "preset", "slowest_rate") if key in options}
        recorded["seed"] = source.artifact.operation.seed or 0
    return LearnOptions(n_components=leaf.n_components, **recorded)
