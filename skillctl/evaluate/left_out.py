"""How well a motion is learned, measured on demonstrations that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillctl.errors import UsageError
from skillctl.evaluate.errors import HeldOut, mean_dtw, mean_dtw_angle, report_errors
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.seds import SedsSkill
from skillctl.progress import Progress
from skillctl.store import DemonstrationReport

MOST_FOLDS = 10


@dataclass(frozen=True, eq=False)
class LeftOut:
    """The index of a demonstration, the skill learned without it, and how well that skill repeats it."""

    index: int
    skill: SedsSkill
    report: DemonstrationReport


def leave_out_in_turn(
    demonstrations: DemonstrationSet, options: LearnOptions, progress: Progress | None = None
) -> tuple[LeftOut, ...]:
    """Return how well skills learned without one demonstration each repeat that demonstration.

    Of more than ``MOST_FOLDS`` demonstrations, a ``MOST_FOLDS``-th is left out at a time.

    Returns:
        One entry per demonstration, in their order.

    Raises:
        UsageError: There is only one demonstration.
    """
    count = len(demonstrations)
    if count < 2:
        raise UsageError(
            "validation leaves out one demonstration at a time, but there is only one.",
            hint="Give more demonstrations, or leave out --validate.",
        )
    folds = min(count, MOST_FOLDS)
    found: list[LeftOut] = []
    for fold in range(folds):
        kept = tuple(d for i, d in enumerate(demonstrations) if i % folds != fold)
        skill = fit(DemonstrationSet(kept, demonstrations.space), options).skill
        left_out = {
            i: d.ending_at(skill.attractor, demonstrations.space)
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
    mean, mean_angle = mean_dtw(reports), mean_dtw_angle(reports)
    return HeldOut(
        demonstrations=len(reports),
        dtw=mean,
        worst_dtw=None if mean is None else max(report.dtw or 0.0 for report in reports),
        arrived=sum(bool(report.arrived) for report in reports),
        dtw_angle=mean_angle,
        worst_dtw_angle=None if mean_angle is None else max(report.dtw_angle or 0.0 for report in reports),
    )
