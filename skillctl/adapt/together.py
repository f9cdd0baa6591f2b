"""One Lyapunov matrix for all parts: found, or made by learning the parts again from what they carry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from skillctl.arrays import FloatArray
from skillctl.compose.lyapunov import common_lyapunov_of, conflicting_parts
from skillctl.compose.options import CombineOptions, MergeOptions
from skillctl.errors import FitError
from skillctl.evaluate.errors import mean_dtw, report_errors
from skillctl.learning.fit import fit, learned_distance
from skillctl.learning.options import Coordinates, LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill, contraction_period
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import at_least
from skillctl.store import DemonstrationReport
from skillctl.store.source import Source, carried_demonstrations, carried_reports
from skillctl.store.ties import LyapunovOrigin

Build: TypeAlias = Callable[[Sequence[Skill], FloatArray], Skill]

SLOW_SHARE = 0.2  # parts are refitted if the common P proves less than this of the slowest part's rate
PERIOD_SHARE = 0.9  # of the shortest certified period of a part: for the whole of it no P leaves a margin


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
class Together:
    """Parts and the Lyapunov matrix that proves them together.

    Attributes:
        parts: As they were, or learned again.
        lyapunov: The common P, shape (d, d).
        origin: ``shared``: all parts had it already. ``found``: by a search. ``refitted``: the parts were
            learned again under it.
        rate: Proved for the skill that was built of them, [1/s].
        refits: Leaves learned again, if any.
        reports: On the demonstrations of all leaves.
        notes: Sentences for the user.
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


def prepared(sources: Sequence[Source], options: MergeOptions | CombineOptions) -> list[Source]:
    """Return the sources with skills and demonstrations as they have to be before one P is looked for."""
    skills = options.prepared([source.skill for source in sources])
    return [
        source if skill is source.skill else _changed(source, skill, turn=options.turn)
        for source, skill in zip(sources, skills, strict=True)
    ]


def _changed(source: Source, skill: Skill, *, turn: bool) -> Source:
    taught = carried_demonstrations([source], skill.leaves, turn=turn)
    return replace(source, artifact=replace(source.artifact, skill=skill, demonstrations=taught))


def prove_together(
    sources: Sequence[Source],
    build: Build,
    *,
    speed: float = 1.0,
    refit: bool = True,
    progress: Progress | None = None,
) -> Together:
    """Return the parts under one Lyapunov matrix with which what ``build`` makes of them is proved.

    The search prefers a P that also proves steps of the controller period that skills are learned for. Where
    it finds no P, or one that proves hardly any decay, the parts are learned again under a common one.

    Args:
        sources: The parts, as ``prepared`` returns them.
        build: Makes the skill to be proved, from parts and P.
        speed: Factor by which ``build`` multiplies the velocity of the parts.
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
            f"no one Lyapunov matrix proves {_conflict(sources)}.",
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
    """Return every leaf of every part learned again, from its demonstrations, under one Lyapunov matrix.

    Raises:
        FitError: A part carries no demonstrations, or the result is not proved.
    """
    taught = _required_demonstrations(sources)
    distance = learned_distance(taught, _coordinates_of(sources))
    leaves: list[SedsSkill] = []
    refits: list[Refit] = []
    reports: list[DemonstrationReport] = []
    owned = [(source, leaf) for source in sources for leaf in source.skill.leaves]
    for number, ((source, old), motions) in enumerate(zip(owned, taught, strict=True)):
        if progress is not None:
            progress(f"refitting {source.name}", number, len(owned))
        fitted = fit(motions, _options_of(source, old), distance=distance)
        new = replace(retargeted(fitted.skill, old.attractor), speed=old.speed)
        before, after = (report_errors(leaf, motions, number) for leaf in (old, new))
        leaves.append(new)
        refits.append(Refit(source.name, number + 1, mean_dtw(before), mean_dtw(after)))
        reports += after
    remaining = iter(leaves)
    parts = tuple(source.skill.with_leaves(lambda _: next(remaining)) for source in sources)
    certificate = certify(build(parts, distance.lyapunov))
    if certificate.verdict != "stable" or certificate.rate is None:
        raise FitError(
            f"the skills, learned again under one Lyapunov matrix, could not be proved: "
            f"{(*certificate.failures, 'no rate was found.')[0]}",
            hint="Learn them again, all with --metric euclidean.",
        )
    return Together(parts, distance.lyapunov, "refitted", certificate.rate, tuple(refits), tuple(reports))


def _required_demonstrations(sources: Sequence[Source]) -> list[DemonstrationSet]:
    taught: list[DemonstrationSet] = []
    for source in sources:
        for motions in source.artifact.demonstrations:
            if motions is None:
                raise FitError(
                    f"no one Lyapunov matrix proves {_conflict(sources)}, and {source.name} carries no "
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


def _conflict(sources: Sequence[Source]) -> str:
    """Return the names of the skills that admit no common Lyapunov matrix, as in ``a and b``."""
    group = conflicting_parts([source.skill for source in sources]) or range(len(sources))
    return " and ".join(sources[index].name for index in group)


def _coordinates_of(sources: Sequence[Source]) -> Coordinates:
    """Return how the parts are to be learned again: in the state if each was asked to be, else as suits."""
    asked = {source.artifact.operation.options.get("coordinates") for source in sources}
    return "identity" if asked == {"identity"} else "auto"


def _own_rate(skill: Skill) -> float:
    """Return the decay rate of a part under the Lyapunov matrices it has; an estimate. [1/s]."""
    return min(
        float(part.form.rates(skill.outer_speed * part.component_matrices).min())
        for part in skill.acting_parts
    )


def _period_of(parts: Sequence[Skill], speed: float) -> float:
    """Return the controller period that skills are learned for, or less if a part is certified for less, [s].

    It is measured in the time of the parts, which passes ``speed`` times as fast.
    """
    own = min(contraction_period(part) for part in parts)
    return min(speed * LearnOptions().period, PERIOD_SHARE * own)
