"""NumPy's files: NPZ archives of arrays, and single NPY arrays, read without ever unpickling."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from itertools import permutations
from math import prod
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.demonstrations.clock import unit_of
from skillctl.demonstrations.columns import Column
from skillctl.demonstrations.files import MAX_BYTES, File, damaged
from skillctl.demonstrations.orientation import CONVENTIONS, HOMOGENEOUS, split_off
from skillctl.demonstrations.recording import Recording, is_even, listed, uniform_times
from skillctl.errors import InputDataError, UsageError, printable
from skillctl.model.space import AXIS_NAMES

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]

MAGIC = b"\x93NUMPY"
RESERVED = ("positions", "velocities", "times", "dt")
NUMERIC = "fiu"  # kinds of dtype: float, signed and unsigned integer
AXES = ("demo", "time", "dim")
UNIT = 0.01  # a unit quaternion, written with two decimals or more, is this close to length one
LAYOUTS = (
    "Save positions (T, d) or (D, T, d) with times or dt; or arrays demo_0, demo_1 ... (T, d) with dt or "
    "demo_0_times ..."
)


def recognises(file: File) -> bool:
    """Return whether the content is an array of NumPy or a ZIP archive, as archives of them are."""
    return file.content.startswith((b"PK\x03\x04", MAGIC))


def read(file: File) -> list[Recording]:
    """Return the demonstrations of an NPZ archive, in one of three layouts, or of an NPY array.

    - ``positions`` (T, d): one demonstration; optional ``velocities`` (T, d), ``times`` (T,);
    - ``positions`` (D, T, d): D of them; optional ``velocities`` (D, T, d), ``times`` (T,) or (D, T);
    - one array (T, d) or (D, T, d) of any name, or several whose names end in a number (``demo_3``): one
      demonstration each, in their order; optional ``<name>_times`` (T,). An NPY file is one array. Arrays
      that are velocities, orientations, forces or grippers by their names are left aside.

    An orientation is read if the user says its convention: in the columns behind the first three, or in an
    array with such a name.

    Without ``times``, an array with the name of a time is one, ``t`` or ``stamp_ns``, if its size fits.

    In all of them a scalar ``dt`` [s] may replace the times. Axes in another order are recognised by their
    sizes, unless ``file.axes`` says the order; and of columns, a time and a unit quaternion by their values.

    Raises:
        InputDataError: The archive is damaged, pickled, too large, or of another layout.
        UsageError: The axes that the user gives are none.
    """
    arrays = _arrays(file.content, file.path)
    return (_stacked if "positions" in arrays else _named)(arrays, _step(arrays, file.path), file)


def _arrays(content: bytes, path: Path) -> Arrays:
    try:
        if content.startswith(MAGIC):
            return {"": np.asarray(np.load(io.BytesIO(content), allow_pickle=False))}
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
            office = "[Content_Types].xml" in archive.namelist()
        if unpacked > MAX_BYTES:  # a small archive may claim terabytes
            raise ValueError(f"{unpacked} bytes unpacked; at most {MAX_BYTES} are read")
        if office:
            raise ValueError("an Office document; export its table as CSV")
        with np.load(io.BytesIO(content), allow_pickle=False) as loaded:
            return {name: np.asarray(loaded[name]) for name in loaded.files}
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen types on damaged archives
        if "pickle" in str(error):
            raise InputDataError(
                f"{path}: holds pickled Python objects, which could run code and are never read.",
                hint=LAYOUTS,
            ) from error
        raise damaged(
            path,
            "NPY array" if content.startswith(MAGIC) else "NPZ archive",
            str(error) or type(error).__name__,
        ) from error


def _stacked(arrays: Arrays, dt: float | None, file: File) -> list[Recording]:
    """Return the demonstrations of an archive with an array ``positions``."""
    unused = tuple(name for name in arrays if name not in RESERVED)
    return _recordings(arrays, ("positions", "velocities", "times"), dt, file, unused)


def _named(arrays: Arrays, dt: float | None, file: File) -> list[Recording]:
    """Return the demonstrations of an archive with one array each, or with one of all."""
    names = [name for name, array in arrays.items() if array.ndim in (2, 3) and array.dtype.kind in NUMERIC]
    names = [name for name in names if len(names) == 1 or Column(name).role.name in ("", "joint")]
    used = {"dt", *names, *(f"{name}_times" for name in names)}
    unused = tuple(name for name in arrays if name not in used)
    if not names or (len(names) > 1 and not all(name[-1:].isdigit() for name in names)):
        raise _unknown_layout(arrays, file.path)  # pos and vel are not two demonstrations
    return [
        recording
        for name in names
        for recording in _recordings(arrays, (name, "", f"{name}_times"), dt, file, unused)
    ]


def _recordings(
    arrays: Arrays, keys: tuple[str, str, str], dt: float | None, file: File, unused: tuple[str, ...]
) -> list[Recording]:
    """Return the demonstrations in an array; the keys are its own and those of its velocities and times."""
    key, path = keys[0], file.path
    positions = _flat(_numbers(arrays, key, path), file)
    velocities = _numbers(arrays, keys[1], path) if keys[1] and keys[1] in arrays else None
    if (
        positions.ndim not in (2, 3)
        or not positions.size
        or (velocities is not None and velocities.shape != positions.shape)
    ):
        raise _unknown_layout(arrays, path)
    if turned := _orientation(arrays, positions.shape, file):
        turn = _numbers(arrays, turned, path).reshape(*positions.shape[:-1], -1)
        positions = np.concatenate([positions, turn], axis=-1)
        velocities = None if velocities is None else np.concatenate([velocities, 0 * turn], axis=-1)
    clock = keys[2] if keys[2] in arrays else _clock(arrays, positions.shape)
    times = None if clock is None else _numbers(arrays, clock, path)
    samples = None if times is None else times.shape[-1:]
    if samples and samples[0] not in positions.shape:
        raise _unknown_layout(arrays, path)
    order, notes = _order(positions.shape, samples, file)
    shape = tuple(positions.shape[axis] for axis in order)
    shape = shape if len(shape) == 3 else (1, *shape)
    if times is not None and times.shape not in (shape[1:2], shape[:2]):
        raise _unknown_layout(arrays, path)
    if times is None:
        times = None if dt is None else uniform_times(dt, shape[1])
    else:
        times = times / (Column(clock or "").unit or unit_of(float(times.flat[0]))).per_base
    inner = "" if key in RESERVED or not key else f"array {printable(key)[:40]}"
    recordings = []
    for i in range(shape[0]):
        outer = f"demonstration {i}" if positions.ndim == 3 else ""
        recordings.append(
            Recording(
                path,
                positions.transpose(order).reshape(shape)[i],
                times=None if times is None else np.broadcast_to(times, shape[:2])[i],
                velocities=None if velocities is None else velocities.transpose(order).reshape(shape)[i],
                part=", ".join(filter(None, (inner, outer))),
                unused=tuple(name for name in unused if name not in (clock, turned)),
                notes=notes,
            )
        )
    return _without_clock_and_quaternion(recordings, file)


def _orientation(arrays: Arrays, shape: tuple[int, ...], file: File) -> str:
    """Return the name of the one array that is the orientation of positions of this shape, if the user asks.

    It is empty if there is none, or several.
    """
    if file.orientation is None or shape[-1] != len(AXIS_NAMES):
        return ""
    size = prod(shape[:-1]) * CONVENTIONS[file.orientation].width
    turns = [name for name in arrays if Column(name).role.name == "orientation" and arrays[name].size == size]
    return turns[0] if len(turns) == 1 else ""


def _flat(values: FloatArray, file: File) -> FloatArray:
    """Return an array of 4 × 4 matrices as one of rows, if the user says that it holds matrices."""
    square = file.orientation == "matrix" and values.ndim > 2 and values.shape[-2:] == (4, 4)
    return values.reshape(*values.shape[:-2], HOMOGENEOUS) if square else values


def _clock(arrays: Arrays, shape: tuple[int, ...]) -> str | None:
    """Return the name of an array that is the times of one with this shape, by its name and size, or None."""
    sizes = {(size,) for size in shape}
    fitting = [name for name, array in arrays.items() if array.shape in sizes and array.dtype.kind in NUMERIC]
    return next((name for name in fitting if name and Column(name).role.name == "time"), None)


def _order(
    shape: tuple[int, ...], samples: tuple[int, ...] | None, file: File
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return which axis of an array is demo (if there are three), time and dim, and notes about it.

    Args:
        shape: Of the array.
        samples: The number of samples, if it is known, as a tuple of one.
        file: The user may say the axes, and how many dimensions there are at most.

    Raises:
        InputDataError: The sizes fit no order, or several.
        UsageError: The axes that the user gives are none.
    """
    names = AXES[-len(shape) :]
    if file.axes is not None:
        if sorted(file.axes) != sorted(names):
            raise UsageError(
                f"axes: {','.join(file.axes)} are not {','.join(names)}, in any order.",
                hint=f"The array of {file.path} has {len(shape)} axes, of sizes {shape}.",
            )
        return tuple(file.axes.index(name) for name in names), ()

    def fits(order: tuple[int, ...]) -> bool:
        # One column more than dimensions: the time may stand before them.
        *_, time, dim = (shape[axis] for axis in order)
        most = HOMOGENEOUS if file.orientation == "matrix" else file.max_dimension
        longest = samples is not None or len(shape) == 2 or time == max(shape)
        return dim <= most + 1 and longest and samples in (None, (time,))

    usual = tuple(range(len(shape)))
    orders = [usual] if fits(usual) else [order for order in permutations(usual) if fits(order)]
    if not orders:
        raise InputDataError(
            f"{file.path}: none of its axes {shape} has at most {file.max_dimension} dimensions.",
            hint=f"Choose some with --axes {','.join(names)} --columns q1,q2,…; or see --max-dimension.",
        )
    if len(orders) > 1:
        raise InputDataError(
            f"{file.path}: the sizes {shape} of its axes do not tell which are {', '.join(names)}.",
            hint=f"Say it with --axes, as in --axes {','.join(names)}.",
        )
    found = ",".join(names[orders[0].index(axis)] for axis in usual)
    note = (f"the axes are read as {found}, by their sizes {shape}; --axes says otherwise.",)
    return orders[0], () if orders[0] == usual else note


def _without_clock_and_quaternion(recordings: list[Recording], file: File) -> list[Recording]:
    """Return recordings without columns that are no coordinates, by their values, with notes about them.

    A first column that rises evenly is the time. Four columns behind three that are unit quaternions are an
    orientation, which is read if the user says its convention, as are others.
    """
    values = np.concatenate([recording.positions for recording in recordings])
    clock = recordings[0].times is None and values.shape[1] > 1
    clock = clock and all(is_even(recording.positions[:, 0]) for recording in recordings)
    first, rest = int(clock), values.shape[1] - int(clock)
    quaternion = rest == 7 and bool((np.abs(np.linalg.norm(values[:, -4:], axis=1) - 1) < UNIT).all())
    aside = quaternion and file.orientation is None
    notes = ["column 0 rises evenly and is read as the time."] * clock
    if aside:
        reads = "" if file.position_only else "; --orientation xyzw or wxyz reads them"
        notes.append(f"columns {first + 3} to {first + 6} are unit quaternions and left aside{reads}.")
    kept = slice(first, first + (len(AXIS_NAMES) if aside else rest))
    plain = [
        replace(
            recording,
            positions=recording.positions[:, kept],
            times=recording.positions[:, 0] if clock else recording.times,
            velocities=None if recording.velocities is None else recording.velocities[:, kept],
            notes=(*recording.notes, *notes),
        )
        for recording in recordings
    ]
    return [split_off(recording, file.orientation) if file.orientation else recording for recording in plain]


def _step(arrays: Arrays, path: Path) -> float | None:
    if "dt" not in arrays:
        return None
    step = _numbers(arrays, "dt", path)
    if step.size != 1 or not (np.isfinite(step.item()) and step.item() > 0):
        raise InputDataError(f"{path}: dt must be one positive number of seconds.", hint=LAYOUTS)
    return float(step.item())


def _numbers(arrays: Arrays, name: str, path: Path) -> FloatArray:
    if arrays[name].dtype.kind not in NUMERIC:
        raise InputDataError(
            f"{path}: array '{printable(name)[:40]}' holds {arrays[name].dtype}, not real numbers.",
            hint=LAYOUTS,
        )
    return arrays[name].astype(np.float64)


def _unknown_layout(arrays: Arrays, path: Path) -> InputDataError:
    holds = listed([f"{name} {array.shape}" for name, array in arrays.items()])
    return InputDataError(f"{path}: its arrays form no demonstrations (found {holds}).", hint=LAYOUTS)
