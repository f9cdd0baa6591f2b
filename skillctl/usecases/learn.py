"""From demonstrations to a skill that is proved stable and written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, cast

from skillctl.demonstrations.faults import told
from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reader import ReadResult
from skillctl.evaluate.errors import HeldOut, mean_dtw, report_errors
from skillctl.evaluate.left_out import LeftOut, held_out, leave_out_in_turn
from skillctl.learning.fit import Fit, fit
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import align, embedded
from skillctl.model.golden import golden_motions
from skillctl.progress import Progress
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import (
    Artifact,
    DemonstrationReport,
    Operation,
    current_provenance,
    input_record,
    require_room_for_records,
)
from skillctl.usecases.destination import Destination
from skillctl.usecases.make import Made, MakeReport, Request, make, require_stable
from skillctl.usecases.options import Robot
from skillctl.usecases.recorded_arm import read_of

INACCURATE = 0.04  # of the extent: a larger mean DTW distance is a warning
LEARN_AGAIN = "Try --preset quality, another --seed, or fewer --components."


@dataclass(frozen=True)
class LearnRequest(Request):
    """What is to be learned, how, and where it goes; see ``learn``."""

    paths: tuple[Path, ...] = ()
    options: LearnOptions = field(default_factory=LearnOptions)
    reading: Reading = field(default_factory=Reading)
    robot: Robot = field(default_factory=Robot)
    validated: bool = False


@dataclass(frozen=True, eq=False)
class Details:
    """What the report says besides the skill.

    Attributes:
        notes: Of the reader, and warnings of the learner.
        left_out: The skills learned without one demonstration each; empty without ``validated``.
    """

    notes: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()


Learned: TypeAlias = Made[Details]


@dataclass(frozen=True, kw_only=True)
class LearnReport(MakeReport):
    """What ``learn`` did.

    Attributes:
        n_components, dimension, unit: Of the skill; unit of a position, ``m`` or ``rad``.
        attractor: Where it ends, in that unit.
        demonstrations: How well it repeats each one.
        converged: Whether the last stage of learning converged; stability does not need it. None where an
            older artifact does not say.
        stages: How each stage of learning ended, in words.
        held_out: Errors on demonstrations left out, if they were asked for.
        target: The attractor in the numbers in which a target is given; of poses with a quaternion.
    """

    n_components: int
    dimension: int
    unit: str
    attractor: tuple[float, ...]
    demonstrations: tuple[DemonstrationReport, ...]
    converged: bool | None
    stages: tuple[str, ...]
    held_out: HeldOut | None
    target: tuple[float, ...]


def learn(
    data: Sequence[str | Path],
    *,
    output: str | Path | None = None,
    name: str | None = None,
    store: str | Path | None = None,
    note: str | None = None,
    options: LearnOptions | None = None,
    reading: Reading | None = None,
    robot: Robot | None = None,
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
        note: To be kept in the skill; another note than that of the skill that is there makes it learn again.
        options: How to learn.
        reading: How to read the files.
        robot: The arm whose joints they hold, if they hold joints and positions are to be learned.
        validated: Also learn with each demonstration left out, and keep the errors on those.
        force: Learn even if the same files and options gave what is there.
        plot: Draw there how the skill repeats its demonstrations; the suffix decides the format.
        progress: Called with (stage, done, total).

    Raises:
        UsageError: Neither or both of output and name, or options that do not go together.
        NotFoundError: A file does not exist.
        InputDataError: Demonstrations that cannot be used.
        FitError: The result could not be proved stable; nothing is written.
        StoreError: More demonstrations than an artifact has room for, or it cannot be written.
    """
    request = LearnRequest(
        destination=Destination.at(output, name, store, note),
        force=force,
        plot=plot,
        paths=tuple(Path(path) for path in data),
        options=options or LearnOptions(),
        reading=reading or Reading(),
        robot=robot or Robot(),
        validated=validated,
    )
    return finish(request, prepare(request, progress))


def prepare(request: LearnRequest, progress: Progress | None = None) -> Learned:
    """Return what a request leads to; nothing is written, so that this can be done anywhere.

    Raises:
        See ``learn``.
    """
    options = request.options
    recorded = _recorded(request)
    read_again = partial(read_of, request.robot, request.reading, request.paths)
    operation = Operation(command="learn", options=recorded, seed=options.seed)

    def build() -> tuple[Artifact, Certificate, Details]:
        read = read_again()
        provenance = current_provenance(
            inputs=[input_record(file.path, file.sha256, file.importer) for file in read.sources]
        )
        require_room_for_records(embedded(*align(read.demonstrations)), operation, provenance)
        fitted = fit(read.demonstrations, options, progress=progress)
        certificate = require_stable(certify(fitted.skill), LEARN_AGAIN)
        left_out = _left_out(read, request, progress)
        ends = [demonstration.positions[-1] for demonstration in read.demonstrations]
        reports = tuple(report_errors(fitted.skill, fitted.demonstrations, ends=ends))
        warnings = (*told(read.faults), *_inaccuracy(fitted, reports))
        results = {**_results(fitted, left_out), "warnings": warnings}
        done = operation.model_copy(update={"results": results})
        golden = golden_motions(fitted.skill)
        artifact = Artifact(fitted.skill, (fitted.demonstrations,), done, provenance, reports, golden)
        return artifact, certificate, Details((*read.notes, *fitted.warnings), left_out)

    made = make(request, operation, build, inputs=(*request.paths, *request.robot.files))
    if made.details is None and request.plot is not None and request.validated:
        # The picture shows the skills of the validation, which are not kept: they are learned again.
        left_out = _left_out(read_again(), request, progress)
        return replace(made, details=Details(left_out=left_out))
    return made


def _inaccuracy(fitted: Fit, reports: Sequence[DemonstrationReport]) -> tuple[str, ...]:
    """Return the warning about a skill that does not do what was shown."""
    distance, space = mean_dtw(reports), fitted.skill.space
    share = math.inf if distance is None else distance / fitted.demonstrations.extent
    if share <= INACCURATE:
        return ()
    off = "some diverge" if distance is None else f"{distance:.2g} {space.unit} off on average"
    return (f"the motions do not follow the demonstrations: {off}, {share:.0%} of the extent.",)


def _left_out(read: ReadResult, request: LearnRequest, progress: Progress | None) -> tuple[LeftOut, ...]:
    if not request.validated:
        return ()
    return leave_out_in_turn(read.demonstrations, request.options, progress)


def finish(request: LearnRequest, learned: Learned) -> LearnReport:
    """Write what was learned, unless it is there already, and return the report.

    Raises:
        StoreError: It cannot be written.
    """
    fields = learned.write(request.destination, "learned")
    artifact, details = learned.artifact, learned.details
    if request.plot is not None:
        from skillctl.usecases.pictures import picture_fit  # late: only pictures need Matplotlib

        picture_fit(fields["written"].skill, artifact, details.left_out if details else (), request.plot)
    skill, results = artifact.skill, artifact.operation.results
    return LearnReport(
        **fields,
        notes=details.notes if details else (),
        n_components=skill.n_components,
        dimension=skill.dimension,
        unit=skill.space.unit,
        attractor=tuple(skill.attractors[0].tolist()),
        demonstrations=artifact.reports,
        converged=cast("bool | None", results.get("converged")),
        stages=cast("tuple[str, ...]", results.get("stages", ())),
        held_out=HeldOut.recorded(results),
        target=skill.space.given(skill.attractors[0]),
    )


def _recorded(request: LearnRequest) -> dict[str, Any]:
    """Return the options that decide the result, by their long names."""
    learning = asdict(request.options)
    learning["components"] = learning.pop("n_components")
    del learning["seed"]  # the operation has a field of its own for it
    validated = {"validate": True} if request.validated else {}
    return {**learning, **request.reading.recorded(), **request.robot.recorded(), **validated}


def _results(fitted: Fit, left_out: tuple[LeftOut, ...]) -> dict[str, Any]:
    return {
        "objective": fitted.objective,
        "log_likelihood": fitted.log_likelihood,
        "deviation_bound": fitted.deviation_bound,
        "rising_share": fitted.rising_share,
        "converged": fitted.converged,
        "stages": tuple(str(stage) for stage in fitted.results),
        **(held_out(left_out).results() if left_out else {}),
    }
