"""How well a motion is learned, told from demonstrations that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.errors import UsageError
from skillctl.evaluate.errors import HeldOut, report_errors
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.seds import SedsSkill
from skillctl.progress import Progress
from skillctl.store import DemonstrationReport

MOST_FOLDS = 10


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A demonstration's index, the skill learned without it, and how well that one repeats it."""

    index: int
    skill: SedsSkill
    report: DemonstrationReport


def validate(
    demonstrations: DemonstrationSet, options: LearnOptions, progress: Progress | None = None
) -> HeldOut:
    """Return the errors on demonstrations left out in turn; see ``leave_out_in_turn``."""
    return held_out(leave_out_in_turn(demonstrations, options, progress))


def leave_out_in_turn(
    demonstrations: DemonstrationSet, options: LearnOptions, progress: Progress | None = None
) -> tuple[LeftOut, ...]:
    """Learn without one demonstration (of more than ten: without a tenth), measure on it, for all in turn.

    Returns:
        One entry per demonstration, in their order.

    Raises:
        UsageError: One demonstration only; nothing can be left out.
    """
    count = len(demonstrations)
    if count < 2:
        raise UsageError(
            "validation leaves out one demonstration at a time, but there is one only.",
            hint="Give more demonstrations, or leave out --validate.",
        )
    folds = min(count, MOST_FOLDS)
    found: list[LeftOut] = []
    for fold in range(folds):
        kept = tuple(d for i, d in enumerate(demonstrations) if i % folds != fold)
        skill = fit(DemonstrationSet(kept, demonstrations.space), options).skill
        left_out = {
            i: d.translated(skill.attractor - d.positions[-1])
            for i, d in enumerate(demonstrations)
            if i % folds == fold
        }
        measured = DemonstrationSet(tuple(left_out.values()), demonstrations.space)
        reports = report_errors(skill, measured)
        found += [LeftOut(i, skill, report) for i, report in zip(left_out, reports, strict=True)]
        if progress is not None:
            progress("validation", fold + 1, folds)
    return tuple(sorted(found, key=lambda each: each.index))


def held_out(left_out: Sequence[LeftOut]) -> HeldOut:
    """Return the errors of a validation, all demonstrations together."""
    reports = [each.report for each in left_out]
    distances = [report.dtw for report in reports if report.dtw is not None]
    whole = len(distances) == len(reports)
    return HeldOut(
        demonstrations=len(reports),
        dtw=float(np.mean(distances)) if whole else None,
        worst_dtw=max(distances) if whole else None,
        arrived=sum(bool(report.arrived) for report in reports),
    )
