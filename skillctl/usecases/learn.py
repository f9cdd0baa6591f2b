"""From demonstrations to a skill that is proved stable and written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reader import ReadResult
from skillctl.evaluate.errors import HeldOut, report_errors
from skillctl.evaluate.left_out import LeftOut, held_out, leave_out_in_turn
from skillctl.learning.fit import Fit, fit
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import align, embedded
from skillctl.learning.solve import Progress as LearningProgress
from skillctl.plotting.formats import require_picture
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import (
    Artifact,
    DemonstrationReport,
    Operation,
    Provenance,
    current_provenance,
    input_record,
    require_room_for_records,
)
from skillctl.usecases.destination import Destination, Written
from skillctl.usecases.make import reasons_to_make
from skillctl.usecases.proof import LEARN_AGAIN, require_stable

Status: TypeAlias = Literal["learned", "up to date"]


@dataclass(frozen=True)
class LearnRequest:
    """What is to be learned, how, and where it goes; see ``learn``."""

    paths: tuple[Path, ...]
    destination: Destination
    options: LearnOptions
    reading: Reading
    validated: bool
    force: bool
    plot: Path | None


@dataclass(frozen=True, eq=False)
class Made:
    """What a request leads to, before it is written.

    Attributes:
        artifact: The skill with all that belongs to it.
        certificate: What is proved of it.
        left_out: What was learned without one demonstration each, if anybody asked.
        notes: What was noticed about the input, and warnings of the learner.
        reasons: Why it was learned, in words.
        current: Where it is already; None if it has to be written.
    """

    artifact: Artifact
    certificate: Certificate
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    current: Written | None = None


@dataclass(frozen=True)
class LearnReport:
    """What ``learn`` did.

    Attributes:
        status: ``learned``, or ``up to date``: the same files and options gave what is there.
        skill, path, digest: How to name it, where it is, what it is.
        created: False if exactly this skill was there already.
        n_components, dimension, unit: Of the skill; unit of a position, ``m`` or ``rad``.
        attractor: Where it ends, in that unit.
        rate, period: Proved: decay rate [1/s], and longest period of a controller [s].
        demonstrations: How well it repeats each one.
        held_out: Errors on demonstrations left out, if they were asked for.
        notes: What was noticed about the input, and warnings of the learner.
        reasons: Why it was learned, in words; none if it was up to date.
    """

    status: Status
    skill: str
    path: Path
    digest: str
    created: bool
    n_components: int
    dimension: int
    unit: str
    attractor: tuple[float, ...]
    rate: float | None
    period: float | None
    demonstrations: tuple[DemonstrationReport, ...]
    held_out: HeldOut | None
    notes: tuple[str, ...]
    reasons: tuple[str, ...] = ()


def learn(
    data: Sequence[str | Path],
    *,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    note: str | None = None,
    options: LearnOptions | None = None,
    reading: Reading | None = None,
    validated: bool = False,
    force: bool = False,
    plot: Path | None = None,
    progress: Progress | None = None,
) -> LearnReport:
    """Learn a skill from demonstrations, prove it stable, and write it.

    Args:
        data: Files, each with one or many demonstrations of one motion.
        output: File to write; or
        name: Skill of the store to publish the next version of.
        store: Where the name lives; default as on the command line.
        note: To be kept in the skill. Another note than the one that is there is a reason to learn again.
        options: How to learn.
        reading: How to read the files.
        validated: Also learn with each demonstration left out, and keep the errors on those.
        force: Learn even if the same files and options gave what is there.
        plot: Draw there how the skill repeats its demonstrations; the suffix decides the format.
        progress: Called with (stage, done, total).

    Raises:
        UsageError: Neither or both of output and name, or options that make no sense.
        NotFoundError: A file does not exist.
        InputDataError: Demonstrations that cannot be used.
        FitError: The result could not be proved stable; nothing is written.
        StoreError: More demonstrations than an artifact has room for, or it cannot be written.
    """
    request = LearnRequest(
        paths=tuple(Path(path) for path in data),
        destination=Destination.at(output, name, store, note),
        options=options or LearnOptions(),
        reading=reading or Reading(),
        validated=validated,
        force=force,
        plot=plot,
    )
    return finish(request, make(request, progress))


def make(request: LearnRequest, progress: Progress | None = None) -> Made:
    """Return what a request leads to; nothing is written, so that this can be done anywhere.

    Raises:
        See ``learn``.
    """
    if request.plot is not None:
        require_picture(request.plot)
    options, reading, validated = request.options, request.reading, request.validated
    operation = Operation(command="learn", options=_recorded(options, reading, validated), seed=options.seed)
    current = request.destination.current()
    reasons = reasons_to_make(
        current[0] if current else None, operation, request.paths, request.destination.note
    )
    if current is not None and not reasons and not request.force:
        artifact, written = current
        again: tuple[LeftOut, ...] = ()
        if request.plot is not None and validated:  # what was left out was not kept: again, for the picture
            again = leave_out_in_turn(reading.read(request.paths).demonstrations, options, progress)
        return Made(artifact, certify(artifact.skill), again, current=written)
    read = reading.read(request.paths)
    provenance = _provenance(read)
    require_room_for_records(embedded(align(read.demonstrations)[0]), operation, provenance)
    fitted = fit(read.demonstrations, options, progress=_adapted(progress))
    certificate = certify(fitted.skill)
    require_stable(certificate, LEARN_AGAIN)
    left_out = leave_out_in_turn(read.demonstrations, options, progress) if validated else ()
    artifact = _artifact(fitted, operation, provenance, held_out(left_out) if left_out else None)
    return Made(
        artifact,
        certificate,
        left_out,
        notes=(*read.notes, *fitted.warnings),
        reasons=reasons or ("it was asked for",),
    )


def finish(request: LearnRequest, made: Made) -> LearnReport:
    """Write what was made, unless it is there already, and return the report.

    Raises:
        StoreError: It cannot be written.
    """
    written = made.current or request.destination.write(made.artifact)
    if request.plot is not None:
        _draw(written, made.artifact, made.left_out, request.plot)
    return _report(made, written)


def _draw(written: Written, artifact: Artifact, left_out: Sequence[LeftOut], plot: Path) -> None:
    from skillctl.usecases.pictures import picture_fit  # late: only pictures need Matplotlib

    picture_fit(written.skill, artifact, left_out, plot)


def _recorded(options: LearnOptions, reading: Reading, validated: bool) -> dict[str, Any]:
    """Return the options that decide the result, by their long names."""
    learning = asdict(options)
    learning["components"] = learning.pop("n_components")
    del learning["seed"]  # the operation has a place of its own for it
    return {**learning, **asdict(reading), **({"validate": True} if validated else {})}


def _adapted(progress: Progress | None) -> Callable[[LearningProgress], None] | None:
    if progress is None:
        return None
    return lambda step: progress(_told(step), step.done, step.total)


def _told(step: LearningProgress) -> str:
    """Return a stage in words: every start is one of its own, told with what it came to."""
    if step.stage != "starts":
        return step.stage
    return f"start {step.done} of {step.total}, objective {step.objective:.3g}"


def _provenance(read: ReadResult) -> Provenance:
    return current_provenance(
        inputs=[input_record(file.path, file.sha256, file.importer) for file in read.sources]
    )


def _artifact(fitted: Fit, operation: Operation, provenance: Provenance, errors: HeldOut | None) -> Artifact:
    results = {
        "objective": fitted.objective,
        "log_likelihood": fitted.log_likelihood,
        "deviation_bound": fitted.deviation_bound,
        "rising_share": fitted.rising_share,
        **(errors.results() if errors else {}),
    }
    return Artifact(
        skill=fitted.skill,
        demonstrations=(fitted.demonstrations,),
        operation=operation.model_copy(update={"results": results}),
        provenance=provenance,
        reports=tuple(report_errors(fitted.skill, fitted.demonstrations)),
    )


def _report(made: Made, written: Written) -> LearnReport:
    skill = made.artifact.skill
    return LearnReport(
        status="up to date" if made.current else "learned",
        skill=written.skill,
        path=written.path,
        digest=written.digest,
        created=written.created,
        n_components=skill.n_components,
        dimension=skill.dimension,
        unit=skill.space.unit,
        attractor=tuple(skill.leaves[0].attractor.tolist()),
        rate=made.certificate.rate,
        period=made.certificate.period,
        demonstrations=made.artifact.reports,
        held_out=HeldOut.recorded(made.artifact.operation.results),
        notes=made.notes,
        reasons=made.reasons,
    )
