"""Chain skills: one acts after the other, each towards its own target, with events between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from skillctl.compose.options import ChainOptions
from skillctl.errors import FitError
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.stability.stages import level_within
from skillctl.store import Artifact, Lock, Operation
from skillctl.store.source import Source, carried_reports, open_skill
from skillctl.store.ties import stage_role
from skillctl.usecases.destination import Destination
from skillctl.usecases.make import (
    CHECK_PARTS,
    MakeReport,
    Request,
    child_artifact,
    make,
    parents_of,
    require_stable,
)

IN_ANOTHER_WAY = "Put the stages in another order, or let one end elsewhere with --target STAGE=X,Y,Z…"


@dataclass(frozen=True)
class StageSummary:
    """One stage of a chain.

    Attributes:
        skill, digest: How the skill was named that it is, and its content digest.
        targets: Where it ends, in the numbers in which targets are given; more than one if it is combined.
        events: What happens once it is over.
    """

    skill: str
    digest: str
    targets: tuple[tuple[float, ...], ...]
    events: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ChainReport(MakeReport):
    """What ``chain`` did; when each stage is over is in ``certificate.course``.

    Attributes:
        parts: The stages, in their order.
        unit: Of a position.
        on_jump: Which stage goes on after a jump of the state.
        disturbance_distance: A jump is by more than this, in that unit.
    """

    parts: tuple[StageSummary, ...]
    unit: str
    on_jump: str
    disturbance_distance: float


def chain(
    skills: Sequence[str | Path],
    *,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    lock: Lock | None = None,
    note: str | None = None,
    options: ChainOptions | None = None,
    force: bool = False,
    plot: Path | None = None,
    progress: Progress | None = None,
) -> ChainReport:
    """Chain skills into one whose stages act one after the other, prove it, and write it.

    Args:
        skills: References to two or more learned, merged or latched combined skills, in their order; one may
            be named more than once.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        note: To be kept in the skill.
        options: When a stage is over, what happens then, and where stages end.
        force: Make it even if the same skills and options gave what is there.
        plot: Draw the chain there; the suffix decides the format.
        progress: Not called: a chain is made in no time.

    Raises:
        UsageError: Skills that cannot be stages, different spaces, options that do not fit the stages.
        NotFoundError, ArtifactError: A skill does not exist, or is not intact.
        FitError: A stage is not proved, or not from where the one before is over; nothing is written.
    """
    options = options or ChainOptions()
    request = Request(Destination.at(output, name, store, note), force, plot)
    sources = [open_skill(reference, store, lock) for reference in skills]
    operation = Operation(command="chain", options=options.recorded())

    def build() -> tuple[Artifact, Certificate, None]:
        made = _made(sources, options)
        certificate = certify(made)
        alone = all(part.proved for part in certificate.parts)
        require_stable(certificate, IN_ANOTHER_WAY if alone else CHECK_PARTS)
        reports = carried_reports(sources)
        artifact = child_artifact(made, sources, operation, reports, turn=options.turn, role=stage_role)
        return artifact, certificate, None

    made = make(request, operation, build, parents=parents_of(sources, stage_role))
    fields = made.write(request.destination, "chained")
    if plot is not None:
        from skillctl.usecases.pictures import picture_skill  # late: only pictures need Matplotlib

        picture_skill(fields["written"].skill, made.artifact, plot)
    skill = cast("ChainedSkill", made.artifact.skill)
    return ChainReport(
        **fields,
        parts=tuple(map(_summary, sources, skill.parts, skill.events)),
        unit=skill.space.unit,
        on_jump=skill.on_jump,
        disturbance_distance=skill.disturbance_distance,
    )


def _summary(source: Source, stage: Skill, events: tuple[str, ...]) -> StageSummary:
    targets = tuple(map(stage.space.given, stage.attractors))
    return StageSummary(source.name, source.artifact.digest, targets, events)


def _made(sources: Sequence[Source], options: ChainOptions) -> ChainedSkill:
    """Return the chain: each stage is over as near to its target as the options say.

    Raises:
        UsageError: See ``chain``.
        FitError: V of a stage says nothing about the distance to its target.
    """
    stages = options.staged([source.skill for source in sources])
    levels = []
    for number, (stage, distance) in enumerate(zip(stages, options.distances(stages), strict=True), start=1):
        level = level_within(stage, distance)
        if level is None:
            raise FitError(
                f"stage {number}: no level of V is known below which it lies within {distance:g} "
                f"{stage.space.unit} of its target.",
                hint=CHECK_PARTS,
            )
        levels.append(level)
    return options.chain(stages, levels)
