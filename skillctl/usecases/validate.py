"""How well a motion is learned, told from demonstrations that were left out."""

from __future__ import annotations

import numpy as np

from skillctl.errors import UsageError
from skillctl.learning import LearnOptions, fit
from skillctl.model import DemonstrationSet
from skillctl.store import DemonstrationReport
from skillctl.usecases.evaluate import HeldOut, report_errors
from skillctl.usecases.progress import Progress

MOST_FOLDS = 10


def validate(
    demonstrations: DemonstrationSet, options: LearnOptions, progress: Progress | None = None
) -> HeldOut:
    """Learn without one demonstration (of more than ten: without a tenth), measure on it, for all in turn.

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
    reports: list[DemonstrationReport] = []
    for fold in range(folds):
        kept = tuple(d for i, d in enumerate(demonstrations) if i % folds != fold)
        skill = fit(DemonstrationSet(kept, demonstrations.space), options).skill
        left_out = tuple(
            d.translated(skill.attractor - d.positions[-1])
            for i, d in enumerate(demonstrations)
            if i % folds == fold
        )
        reports += report_errors(skill, DemonstrationSet(left_out, demonstrations.space))
        if progress is not None:
            progress("validation", fold + 1, folds)
    distances = [report.dtw for report in reports if report.dtw is not None]
    whole = len(distances) == len(reports)
    return HeldOut(
        demonstrations=len(reports),
        dtw=float(np.mean(distances)) if whole else None,
        worst_dtw=max(distances) if whole else None,
        arrived=sum(bool(report.arrived) for report in reports),
    )
