"""NPZ archives of NumPy arrays, read without ever unpickling."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import MAX_BYTES, File, damaged
from skillctl.demonstrations.recording import Recording, listed, uniform_times
from skillctl.errors import InputDataError, printable

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]

RESERVED = ("positions", "velocities", "times", "dt")
NUMERIC = "fiu"  # kinds of dtype: float, signed and unsigned integer
LAYOUTS = (
    "Save positions (T, d) or (D, T, d) with times or dt; or arrays demo_0, demo_1 ... (T, d) with dt or "
    "demo_0_times ..."
)


def recognises(file: File) -> bool:
    """Return whether the content is a ZIP archive, as NumPy archives are."""
    return file.content.startswith(b"PK\x03\x04")


def read(file: File) -> list[Recording]:
    """Return the demonstrations of an NPZ archive, in one of three layouts.

    - ``positions`` (T, d): one demonstration; optional ``velocities`` (T, d), ``times`` (T,);
    - ``positions`` (D, T, d): D of them; optional ``velocities`` (D, T, d), ``times`` (T,) or (D, T);
    - one array (T, d) of any name, or several whose names end in a number (``demo_3``): one demonstration
      each, in their order; optional ``<name>_times`` (T,).

    In all of them a scalar ``dt`` [s] may replace the times.

    Raises:
        InputDataError: The archive is damaged, pickled, too large, or of another layout.
    """
    arrays = _arrays(file.content, file.path)
    dt = _step(arrays, file.path)
    return (_stacked if "positions" in arrays else _named)(arrays, dt, file.path)


def _arrays(content: bytes, path: Path) -> Arrays:
    try:
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
        raise damaged(path, "NPZ archive", str(error) or type(error).__name__) from error


def _stacked(arrays: Arrays, dt: float | None, path: Path) -> list[Recording]:
    """Return the demonstrations of an archive with an array ``positions``."""
    positions = _numbers(arrays, "positions", path)
    velocities = _numbers(arrays, "velocities", path) if "velocities" in arrays else None
    if positions.ndim not in (2, 3) or (velocities is not None and velocities.shape != positions.shape):
        raise _unknown_layout(arrays, path)
    shape = positions.shape if positions.ndim == 3 else (1, *positions.shape)
    times = _times(arrays, "times", dt, (shape[1:2], shape[:2]), path)
    return [
        Recording(
            path,
            positions.reshape(shape)[i],
            times=None if times is None else np.broadcast_to(times, shape[:2])[i],
            velocities=None if velocities is None else velocities.reshape(shape)[i],
            part=f"demonstration {i}" if positions.ndim == 3 else "",
            unused=tuple(name for name in arrays if name not in RESERVED),
        )
        for i in range(shape[0])
    ]


def _named(arrays: Arrays, dt: float | None, path: Path) -> list[Recording]:
    """Return the demonstrations of an archive with one array (T, d) each."""
    names = [name for name, array in arrays.items() if array.ndim == 2 and array.dtype.kind in NUMERIC]
    used = {"dt", *names, *(f"{name}_times" for name in names)}
    unused = tuple(name for name in arrays if name not in used)
    if not names or (len(names) > 1 and not all(name[-1:].isdigit() for name in names)):
        raise _unknown_layout(arrays, path)  # pos and vel are not two demonstrations
    recordings = []
    for name in names:
        positions = _numbers(arrays, name, path)
        times = _times(arrays, f"{name}_times", dt, (positions.shape[:1],), path)
        part = f"array {printable(name)[:40]}"
        recordings.append(Recording(path, positions, times=times, part=part, unused=unused))
    return recordings


def _times(
    arrays: Arrays, name: str, dt: float | None, shapes: tuple[tuple[int, ...], ...], path: Path
) -> FloatArray | None:
    """Return the times in an array of one of these shapes, those that follow from dt, or None."""
    if name not in arrays:
        return None if dt is None else uniform_times(dt, *shapes[0])
    times = _numbers(arrays, name, path)
    if times.shape not in shapes:
        raise _unknown_layout(arrays, path)
    return times


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
