"""Read demonstrations from files of any known format, chosen by their content."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from skillctl.demonstrations.checks import judge, prepare, set_notes
from skillctl.demonstrations.faults import Fault
from skillctl.demonstrations.files import LIMITS, NO_PLUGINS, File, read_bytes
from skillctl.demonstrations.formats import format_of, named
from skillctl.demonstrations.recording import Recording, Unit, column_indices, listed
from skillctl.errors import InputDataError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.space import AXIS_NAMES, Euclidean, default_names
from skillctl.workers.child import Child


@dataclass(frozen=True, slots=True)
class InputFile:
    """A file that was read.

    Attributes:
        path: As the user named it.
        sha256: Of its bytes, in hexadecimal.
        importer: Name of its format, one of ``FORMATS``.
    """

    path: Path
    sha256: str
    importer: str


@dataclass(frozen=True, eq=False, slots=True)
class ReadResult:
    """Demonstrations, the files they come from, and what was noticed.

    Attributes:
        demonstrations: Without the samples that were lost.
        sources: The files.
        notes: Sentences for the user.
        faults: Of the recordings, small ones and such as commands refuse.
        chosen: Which demonstrations these are, counted from 0 over all files.
    """

    demonstrations: DemonstrationSet
    sources: tuple[InputFile, ...]
    notes: tuple[str, ...]
    faults: tuple[Fault, ...] = ()
    chosen: tuple[int, ...] = ()


def read_demonstrations(
    paths: Sequence[Path],
    *,
    input_format: str | None = None,
    columns: Sequence[str] | None = None,
    dt: float | None = None,
    units: Unit | None = None,
    scale: float = 1.0,
    demos: Sequence[int] | None = None,
    frame: str = "base",
) -> ReadResult:
    """Return the demonstrations in files, converted to one state space in metres (or radians).

    Every file may hold one or many; formats may be mixed. Times start at zero in each demonstration.

    Args:
        paths: Files of any of ``FORMATS``.
        input_format: Name of a format: read every file as this one instead of looking at its content.
        columns: Names of the position columns, in this order: of a table's columns or a skeleton's joints, of
            a robomimic dataset's observations; x, y, z (or q1 …) in formats without names.
        dt: Sampling period of files that say nothing about time, [s].
        units: Unit of the positions. By default the format's: millimetres for LASA, metres otherwise.
            ``rad`` makes it a joint space.
        scale: Factor on all positions and velocities, after the conversion to metres.
        demos: Which demonstrations to take, counted from 0 over all files; the others are not checked.
        frame: Frame in which the positions are given; it is only recorded.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: A file is unusable; the message gives file and place.
        UsageError: Options are out of range, or select a demonstration that does not exist.
    """
    forced = None if input_format is None else named(input_format)
    _require_positive(dt=dt, scale=scale)
    recordings: list[Recording] = []
    sources = []
    with Child(LIMITS, NO_PLUGINS) as child:
        for path in map(Path, paths):
            file = File(path, read_bytes(path), columns, child)
            form = format_of(file) if forced is None else forced
            recordings += [_as_asked(recording, columns, units) for recording in form.read(file)]
            sources.append(InputFile(path, hashlib.sha256(file.content).hexdigest(), form.name))
    chosen = _chosen(len(recordings), demos)
    selection = [recordings[index] for index in chosen]
    names = _names(selection)
    prepared = [prepare(recording, dt=dt, scale=scale) for recording in selection]
    space = Euclidean(names, unit="rad" if units == "rad" else "m", frame=frame)
    demonstrations = DemonstrationSet(tuple(demonstration for demonstration, _ in prepared), space)
    findings = [found for _, found in prepared]
    notes = _file_notes(selection, sources, dt, units) + set_notes(demonstrations, findings)
    faults = tuple(
        fault if fault.demo is None else replace(fault, demo=chosen[fault.demo]) for fault in judge(findings)
    )
    return ReadResult(demonstrations, tuple(sources), tuple(notes), faults, chosen)


def _require_positive(**numbers: float | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise UsageError(f"{name}: must be a positive number, got {value!r}.")


def _as_asked(recording: Recording, columns: Sequence[str] | None, units: Unit | None) -> Recording:
    """Return the recording with the unit that the user gives and, in formats without names, the columns."""
    unit = units or recording.unit
    if columns is None or recording.names is not None:
        return replace(recording, unit=unit)
    names = default_names(recording.positions.shape[1], unit)
    indices = list(column_indices(columns, names, recording.path))
    return replace(
        recording,
        unit=unit,
        positions=recording.positions[:, indices],
        velocities=None if recording.velocities is None else recording.velocities[:, indices],
        names=tuple(columns),
    )


def _chosen(count: int, demos: Sequence[int] | None) -> tuple[int, ...]:
    """Return which of ``count`` demonstrations are to be read."""
    for index in demos or ():
        if not 0 <= index < count:
            raise UsageError(
                f"demonstration {index} does not exist; there are {count}, counted from 0.",
                hint="Choose others with --demos.",
            )
    return tuple(range(count) if demos is None else dict.fromkeys(demos))


def _names(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the names that all recordings share.

    Raises:
        InputDataError: Dimensions or names differ between files.
    """
    named = next((r for r in recordings if r.names is not None), recordings[0] if recordings else None)
    if named is None:
        raise InputDataError("no demonstrations.", hint="Name at least one demonstration file.")
    dimension = named.positions.shape[1]
    names = named.names or default_names(dimension, named.unit)
    for recording in recordings:
        width = recording.positions.shape[1]
        if width != dimension or recording.names not in (None, names):
            what = f"{width} dimensions" if recording.names is None else f"columns {listed(recording.names)}"
            raise InputDataError(
                f"{recording.label}: {what}, but {named.label} has {listed(names)}.",
                hint="All demonstrations of one skill need the same columns; choose them with --columns.",
            )
    return names


def _file_notes(
    recordings: Sequence[Recording], sources: Sequence[InputFile], dt: float | None, units: Unit | None
) -> list[str]:
    """Return notes on the files and on how they were read."""
    notes = []
    unused = dict.fromkeys(name for recording in recordings for name in recording.unused)
    if unused:
        notes.append(f"left aside: {listed(tuple(unused))}; use --columns to choose others.")
    if dt is not None and any(recording.times is not None for recording in recordings):
        notes.append("--dt is not used for files that contain times.")
    dimension = recordings[0].positions.shape[1]
    if units is None and dimension > len(AXIS_NAMES):
        notes.append(f"{dimension} dimensions are taken as metres; joint angles need --units rad.")
    first: dict[str, Path] = {}
    for source in sources:
        same = first.setdefault(source.sha256, source.path)
        if same is not source.path:
            notes.append(f"{source.path} has the same content as {same}.")
    return notes
