"""Parts that are proved together: one Lyapunov matrix for all, found, or made by learning them again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from skillctl.adapt.refit import Refit, conflict_of, refit_parts
from skillctl.arrays import FloatArray
from skillctl.compose.lyapunov import common_lyapunov_of
from skillctl.errors import FitError
from skillctl.learning.options import LearnOptions
from skillctl.model.skill import Skill, contraction_period
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import at_least
from skillctl.store import DemonstrationReport
from skillctl.store.source import Source, carried_reports
from skillctl.store.ties import LyapunovOrigin

Build: TypeAlias = Callable[[Sequence[Skill], FloatArray], Skill]

SLOW_SHARE = 0.2  # a common P that proves less than this of the slowest part's rate is worth a refit
PERIOD_SHARE = 0.9  # of the shortest certified period of a part: at all of it no P has any margin


@dataclass(frozen=True, eq=False)
class Together:
    """Parts and the Lyapunov matrix that proves them together.

    Attributes:
        parts: As they were, or learned again.
        lyapunov: The common P, shape (d, d).
        origin: ``shared`` by all parts already, ``found`` for them, or parts ``refitted`` under it.
        rate: Proved for the skill that was built of them, [1/s].
        refits: Leaves learned again, if any.
        reports: On the demonstrations of all leaves.
        notes: What is worth knowing, in sentences.
    """

    parts: tuple[Skill, ...]
    lyapunov: FloatArray
    origin: LyapunovOrigin
    rate: float
    refits: tuple[Refit, ...]
    reports: tuple[DemonstrationReport, ...]
    notes: tuple[str, ...] = ()

    @property
    def results(self) -> dict[str, Any]:
        """What an operation records of it."""
        results: dict[str, Any] = {"lyapunov": self.origin}
        if self.refits:
            results["dtw_before"] = tuple(refit.dtw_before for refit in self.refits)
            results["dtw_after"] = tuple(refit.dtw_after for refit in self.refits)
        return results


def prove_together(
    sources: Sequence[Source],
    build: Build,
    *,
    speed: float = 1.0,
    refit: bool = True,
    progress: Progress | None = None,
) -> Together:
    """Return the parts under one Lyapunov matrix with which what ``build`` makes of them is proved.

    A P that also proves steps of the controller period skills are learned for is preferred. Where no P is
    found, or only one that proves next to no decay, the parts are learned again under a common one.

    Args:
        sources: The parts.
        build: Makes the skill to be proved, from parts and P.
        speed: Factor on the velocity that it puts on them.
        refit: Whether parts may be learned again.
        progress: Called with (stage, done, total) while parts are refitted.

    Raises:
        FitError: No common P, and no refit possible or wanted; or no proof.
    """
    found = _as_they_are(sources, build, speed)
    wanted = SLOW_SHARE * speed * min(_own_rate(source.skill) for source in sources)
    if found is not None and found.rate >= wanted:
        return found
    embedded = all(taught is not None for source in sources for taught in source.artifact.demonstrations)
    if refit and (found is None or embedded):
        again = _learned_again(sources, build, progress)
        if found is None:
            return again
        if again.rate > found.rate:
            note = (
                "one Lyapunov matrix for the skills as they were would prove a decay of "
                f"{at_least(found.rate)} 1/s only; learned again, {at_least(again.rate)} 1/s are proved."
            )
            return replace(again, notes=(note,))
    if found is None:
        raise FitError(
            f"no one Lyapunov matrix proves {conflict_of(sources)}.",
            hint="Leave out --no-refit to learn them again under a common one.",
        )
    return found


def _as_they_are(sources: Sequence[Source], build: Build, speed: float) -> Together | None:
    """Return the parts with a common P that provably serves them, else None."""
    parts = tuple(source.skill for source in sources)
    for period in (_period_of(parts, speed), 0.0):
        lyapunov = common_lyapunov_of(parts, period=period)
        if lyapunov is None:
            continue
        certificate = certify(build(parts, lyapunov))
        if certificate.verdict == "stable" and certificate.rate is not None:
            shared = all((leaf.lyapunov == lyapunov).all() for part in parts for leaf in part.leaves)
            origin: LyapunovOrigin = "shared" if shared else "found"
            reports = tuple(carried_reports(sources))
            return Together(parts, lyapunov, origin, certificate.rate, (), reports)
    return None


def _learned_again(sources: Sequence[Source], build: Build, progress: Progress | None) -> Together:
    again = refit_parts(sources, progress)
    certificate = certify(build(again.parts, again.lyapunov))
    if certificate.verdict != "stable" or certificate.rate is None:
        raise FitError(
            f"the skills, learned again under one Lyapunov matrix, could not be proved: "
            f"{(*certificate.failures, 'no rate was found.')[0]}",
            hint="Learn them again, all with --metric euclidean.",
        )
    return Together(again.parts, again.lyapunov, "refitted", certificate.rate, again.refits, again.reports)


def _own_rate(skill: Skill) -> float:
    """Return the decay rate of a part under the Lyapunov matrices it has; an estimate. [1/s]."""
    return min(
        float(part.form.rates(skill.outer_speed * part.component_matrices).min())
        for part in skill.acting_parts
    )


def _period_of(parts: Sequence[Skill], speed: float) -> float:
    """Return the controller period that skills are learned for, or less where a part is certified for less.

    In the time of the parts, which ``speed`` makes pass faster. [s].
    """
    own = min(contraction_period(part) for part in parts)
    return min(speed * LearnOptions().period, PERIOD_SHARE * own)
