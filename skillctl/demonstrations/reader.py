"""Read demonstrations from files of any known format, chosen by their content."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skillctl.demonstrations.arm import RecordedArm
from skillctl.demonstrations.checks import Findings, judge, prepare, set_notes
from skillctl.demonstrations.faults import Fault
from skillctl.demonstrations.files import LIMITS, NO_PLUGINS, OPENED, File, read_bytes
from skillctl.demonstrations.formats import digest_of, format_of, named, size_of
from skillctl.demonstrations.orientation import CONVENTIONS, characteristic_length, is_unmeasured
from skillctl.demonstrations.recording import Recording, column_indices, listed
from skillctl.demonstrations.units import UNITS
from skillctl.errors import InputDataError, UsageError, printable
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.pose import Pose
from skillctl.model.space import AXIS_NAMES, Euclidean, Space, default_names
from skillctl.workers.child import Child
from skillctl.workers.limits import Limits

DAY = 86400.0  # [s]
TURN = 6.6  # [rad]; angles of joints are smaller than a turn, unless they are degrees

BYTES_PER_SECOND = 10**8  # that a parser reads at least: a disk may be slow, and a bag compressed


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
    units: str | None = None,
    scale: float = 1.0,
    demos: Sequence[int] | None = None,
    axes: Sequence[str] | None = None,
    max_dimension: int = 7,
    frame: str = "base",
    topic: str | None = None,
    orientation: str | None = None,
    position_only: bool = False,
    reverse: bool = False,
    arm: RecordedArm | None = None,
) -> ReadResult:
    """Return the demonstrations in files, converted to one state space in metres (or radians).

    Every file may hold one or many; formats may be mixed. Times start at zero in each demonstration. If all
    hold the orientation of what moves, too, they are demonstrations of poses, whose rotation vectors are
    continuous. An orientation that is exactly none in all samples was not measured, and is left aside.

    Args:
        paths: Files of any of ``FORMATS``.
        input_format: Name of a format: read every file as this one instead of looking at its content.
        columns: Names of the position columns, in this order: of a table's columns or a skeleton's joints, of
            a robomimic dataset's observations; x, y, z (or q1 …) in formats without names. ``new=old``
            renames one; a new name of a time, such as ``t_ms``, makes it the time.
        dt: Sampling period of files that say nothing about time, [s].
        units: Unit of the positions. By default what the file says, else the format's: millimetres for LASA,
            metres otherwise. ``rad`` and ``deg`` make it a joint space.
        scale: Factor on all positions and velocities, after the conversion to metres.
        demos: Which demonstrations to take, counted from 0 over all files; the others are not checked.
        axes: What the axes of arrays are: demo, time and dim, in their order.
        max_dimension: Motions of more dimensions are refused.
        frame: Frame in which the positions are given; it is only recorded.
        topic: Topic that is read of a bag; of transforms with the frame that moves, as in ``/tf:tool0``.
        orientation: Convention of orientations, one of ``orientation.CONVENTIONS``, where names do not tell
            it; of arrays, it says that the columns behind the first three are one.
        position_only: Leave orientations aside.
        reverse: Every demonstration is a recording backwards: it ends where the recording began.
        arm: The arm whose joints the files hold; the demonstrations are those of its hand.

    Raises:
        NotFoundError: There is no such file, or the package that reads it is not installed.
        InputDataError: A file is unusable; the message gives file and place.
        UsageError: Options are out of range, or select a demonstration that does not exist.
    """
    forced = None if input_format is None else named(input_format)
    _require_positive(dt=dt, scale=scale)
    if orientation is not None and (position_only or orientation not in CONVENTIONS):
        known = (
            "and --position-only exclude each other"
            if position_only
            else f"is none of {listed([*CONVENTIONS])}"
        )
        raise UsageError(f"--orientation {printable(orientation)} {known}.")
    recordings: list[Recording] = []
    sources = []
    old, renamed = _renamed(columns)
    most = max_dimension if arm is None else max(max_dimension, len(arm.joints))
    with Child(_limits(paths), NO_PLUGINS) as child:
        for path in map(Path, paths):
            file = File(
                path, read_bytes(path), old, child, renamed, axes, most, topic, orientation, position_only
            )
            form, sha256 = format_of(file, forced), _sha256(file)
            recordings += [_as_asked(recording, file, units) for recording in form.read(file)]
            sources.append(InputFile(path, sha256, form.name))
    if topic is not None and all(source.importer != "bag" for source in sources):
        raise UsageError("topic: none of the files is a bag, and only bags have topics.")
    chosen = _chosen(len(recordings), demos)
    selection = [recordings[index] for index in chosen]
    if arm is not None:
        selection = [arm.hand_of(recording) for recording in selection]
    names = _names(selection, max_dimension)
    if position_only or (orientation is None and is_unmeasured(selection)):
        selection = [replace(recording, orientation=None) for recording in selection]
    _require_alike(selection)
    prepared = [prepare(recording, dt=dt, scale=scale, reverse=reverse) for recording in selection]
    _require_short(prepared)
    demonstrations = _in_one_space(
        [demonstration for demonstration, _ in prepared], selection[0], names, frame
    )
    findings = [found for _, found in prepared]
    notes = _file_notes(selection, sources, dt, units) + set_notes(demonstrations, findings)
    faults = tuple(
        fault if fault.demo is None else replace(fault, demo=chosen[fault.demo]) for fault in judge(findings)
    )
    return ReadResult(demonstrations, tuple(sources), tuple(notes), faults, chosen)


def _limits(paths: Sequence[Path]) -> Limits:
    """Return the limits for parsing any of the files: a large one takes longer."""
    largest = max((size_of(Path(path)) for path in paths), default=0)
    return replace(LIMITS, seconds=LIMITS.seconds + largest // BYTES_PER_SECOND)


def _sha256(file: File) -> str:
    """Return the SHA-256 of a file, before a parser opens it: what changes later is seen to have changed."""
    if file.path.is_dir() or file.content.startswith(OPENED):
        return digest_of(file.path)
    return hashlib.sha256(file.content).hexdigest()


def _in_one_space(
    demonstrations: Sequence[Demonstration], first: Recording, names: tuple[str, ...], frame: str
) -> DemonstrationSet:
    """Return demonstrations in the space of the first recording; ``names`` are those of its positions."""
    space: Space = Euclidean(names, unit="rad" if first.base == "rad" else "m", frame=frame)
    if first.orientation is not None:
        length = characteristic_length([each.positions for each in demonstrations])
        space = Pose(length=length, frame=frame)
    return DemonstrationSet(tuple(demonstrations), space)


def _require_short(prepared: Sequence[tuple[Demonstration, Findings]]) -> None:
    """Raise InputDataError if a recording lasts longer than a day: no motion does."""
    longest, found = max(prepared, key=lambda each: each[0].duration)
    if longest.duration > DAY:
        unit = next((u for u in ("ms", "us") if longest.duration < DAY / 100 * UNITS[u].per_base), "ns")
        raise InputDataError(
            f"{found.label}: it lasts {longest.duration:.3g} s, more than a day; its times are no seconds.",
            hint=f"Say their unit in the header or with --columns, as in t_{unit} or --columns t_{unit}=t.",
        )


def _require_alike(recordings: Sequence[Recording]) -> None:
    """Raise InputDataError if some recordings have an orientation and others do not, or of joint angles."""
    having = [recording for recording in recordings if recording.orientation is not None]
    lacking = [recording for recording in recordings if recording.orientation is None]
    if having and lacking:
        raise InputDataError(
            f"{lacking[0].label}: it has no orientation that is read, but {having[0].label} has one.",
            hint="Choose columns, say its --orientation, or learn positions only with --position-only.",
        )
    if having and having[0].base == "rad":
        raise InputDataError(
            f"{having[0].label}: the position beside its orientation is in {having[0].unit}.",
            hint="Say the unit of the position, --units m, or learn positions only with --position-only.",
        )


def _require_positive(**numbers: float | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise UsageError(f"{name}: must be a positive number, got {value!r}.")


def _renamed(columns: Sequence[str] | None) -> tuple[list[str] | None, dict[str, str]]:
    """Return the names of columns in the files, and new names by these; ``new=old`` gives one.

    Raises:
        UsageError: One of them is empty.
    """
    if columns is None:
        return None, {}
    pairs = [(new.strip(), old.strip()) for new, _, old in (name.rpartition("=")[::1] for name in columns)]
    if any("=" in name and not (new and old) for name, (new, old) in zip(columns, pairs, strict=True)):
        raise UsageError("columns: NEW=OLD needs both names.", hint="As in --columns x=hand_x,y=hand_y.")
    return [old for _, old in pairs], {old: new for new, old in pairs if new}


def _as_asked(recording: Recording, file: File, units: str | None) -> Recording:
    """Return the recording with the unit that the user gives and, in formats without names, the columns.

    Raises:
        InputDataError: The file says another unit, or one that needs the user's.
    """
    if units is None and recording.base == "px":
        raise InputDataError(
            f"{recording.path}: its positions are in pixels.",
            hint="Say how large one is: --units m --scale METRES_PER_PIXEL.",
        )
    if units not in (None, recording.unit) and recording.unit_said and recording.base != "px":
        raise InputDataError(
            f"{recording.path}: its positions are in {recording.unit}, and --units says {units}.",
            hint="Leave out --units, or correct the header.",
        )
    if units is None and recording.base == "rad" and not recording.unit_said:
        farthest = float(np.nan_to_num(np.abs(recording.positions)).max(initial=0.0))
        if farthest > TURN:
            raise InputDataError(
                f"{recording.label}: joint angles up to {farthest:.4g}; are they degrees?",
                hint="Say it with --units deg, or --units rad.",
            )
    recording = replace(recording, unit=units or recording.unit)
    columns = file.columns
    if columns is None or recording.names is not None:
        return recording
    names = default_names(recording.positions.shape[1], recording.base)
    indices = list(column_indices(columns, names, recording.path))
    return replace(
        recording,
        positions=recording.positions[:, indices],
        velocities=None if recording.velocities is None else recording.velocities[:, indices],
        names=tuple(file.renamed.get(name, name) for name in columns),
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


def _names(recordings: Sequence[Recording], most: int) -> tuple[str, ...]:
    """Return the names that all recordings share.

    Raises:
        InputDataError: Dimensions, names, frames or kinds of units differ, or there are too many.
    """
    named = next((r for r in recordings if r.names is not None), recordings[0] if recordings else None)
    if named is None:
        raise InputDataError("no demonstrations.", hint="Name at least one demonstration file.")
    dimension = named.positions.shape[1]
    names = named.names or default_names(dimension, named.base)
    if dimension > most:
        raise InputDataError(
            f"{named.label}: {dimension} dimensions; a motion has at most {most}.",
            hint=f"Choose some with --columns. With --max-dimension {dimension} learning may take very long.",
        )
    for recording in recordings:
        width = recording.positions.shape[1]
        if recording.base != named.base:
            raise InputDataError(
                f"{recording.label}: in {recording.unit}, but {named.label} is in {named.unit}.",
                hint="Positions and joint angles make no skill together; choose files or --units.",
            )
        if recording.frame != named.frame and recording.frame and named.frame:
            raise InputDataError(
                f"{recording.label}: in the frame {printable(recording.frame)}, but {named.label} is in "
                f"{printable(named.frame)}.",
                hint="Learn them apart, or record them in one frame.",
            )
        if width != dimension or recording.names not in (None, names):
            what = f"{width} dimensions" if recording.names is None else f"columns {listed(recording.names)}"
            raise InputDataError(
                f"{recording.label}: {what}, but {named.label} has {listed(names)}.",
                hint="All demonstrations of one skill need the same columns; choose them with --columns.",
            )
    return names


def _file_notes(
    recordings: Sequence[Recording], sources: Sequence[InputFile], dt: float | None, units: str | None
) -> list[str]:
    """Return notes on the files and on how they were read."""
    notes = list(dict.fromkeys(note for recording in recordings for note in recording.notes))
    taken = dict.fromkeys(name for recording in recordings for name in recording.taken)
    turns = [recording.orientation for recording in recordings if recording.orientation is not None]
    for names, convention in dict.fromkeys((turn.names, turn.convention) for turn in turns):
        what = f"is {listed(names)}:" if names else "is read as"
        notes.append(
            f"the orientation {what} {CONVENTIONS[convention].words}; --position-only leaves it aside."
        )
    used = {name for turn in turns for name in turn.names}
    unused = dict.fromkeys(name for recording in recordings for name in recording.unused if name not in used)
    if unused:
        positions = f"the position is {listed(tuple(taken))}; " if taken else ""
        notes.append(f"{positions}left aside: {listed(tuple(unused))}; use --columns to choose others.")
    if dt is not None and any(recording.times is not None for recording in recordings):
        notes.append("--dt is not used for files that contain times.")
    first, dimension = recordings[0], recordings[0].positions.shape[1]
    if units is None and not first.unit_said and (first.base == "rad" or dimension > len(AXIS_NAMES)):
        notes.append(
            "joint angles are taken as radians; degrees need --units deg."
            if first.base == "rad"
            else f"{dimension} dimensions are taken as metres; joint angles need --units rad or --units deg."
        )
    paths: dict[str, Path] = {}
    for source in sources:
        same = paths.setdefault(source.sha256, source.path)
        if same is not source.path:
            notes.append(f"{source.path} has the same content as {same}.")
    return notes
