"""robomimic datasets: HDF5 files with one group per demonstration, ``data/demo_<i>/obs/<key>``."""

from __future__ import annotations

from typing import Any

from skillctl.demonstrations.columns import Column
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import Recording, column_indices, listed, uniform_times
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

POSITION = "robot0_eef_pos"  # the observation read unless others are chosen: the first hand, in metres

POSITION_WORDS = {"pos", "position", "xyz"}


def recognises(file: File) -> bool:
    """Return whether the content is an HDF5 file, which may begin behind a block of its user."""
    starts = (0, *(512 << i for i in range(16)))  # where the library looks for it
    return any(file.content.startswith(b"\x89HDF\r\n\x1a\n", start) for start in starts)


def read(file: File) -> list[Recording]:
    """Return the demonstrations in a robomimic dataset, in the order of their numbers.

    ``file.columns`` names observations; several are stacked side by side. The sampling period is one over the
    ``control_freq`` of the environment that the dataset was recorded in, if the file gives it.

    Raises:
        InputDataError: The file is damaged or of another layout, lacks an observation, or links to others.

    References:
        Mandlekar et al. 2021, "What Matters in Learning from Offline Human Demonstrations", and the
        description of the dataset structure in robomimic's documentation.
    """
    path, wanted = file.path, list(file.columns or [POSITION])
    dataset = file.parsed(parse, "HDF5 file", keys=wanted)
    widths, frequency = dataset["widths"], dataset["frequency"]
    if not dataset["count"]:
        raise InputDataError(
            f"{path}: an HDF5 file of unknown layout (found {listed(dataset['members']) or 'nothing'}).",
            hint=f"Expected a robomimic dataset: data/demo_0/obs/{POSITION}.",
        )
    if not widths:
        raise InputDataError(
            f"{path}: its demonstrations hold no observations.",
            hint="Extract them from the states, with robomimic's script dataset_states_to_obs.py.",
        )
    for key in set(wanted) & set(dataset["others"]):
        raise InputDataError(
            f"{path}: the observation '{printable(key)}' has the shape {dataset['others'][key]}, "
            "where positions have (T, d).",
            hint=f"Store it as a matrix, or choose with --columns. The others are: {listed(tuple(widths))}.",
        )
    if file.columns is None and POSITION not in widths:
        found = [key for key in widths if POSITION_WORDS & set(Column(key).words)]
        raise InputDataError(
            f"{path}: there is no observation '{POSITION}', which is read unless another is chosen.",
            hint=f"Choose with --columns, as in --columns {printable((found or list(widths))[0])}. "
            f"The observations are: {listed(tuple(widths))}.",
        )
    column_indices(wanted, list(widths), path, what="observation")
    names = _names({file.renamed.get(key, key): widths[key] for key in wanted})
    unused = () if file.columns is not None else tuple(key for key in widths if key not in wanted)
    return [
        Recording(
            path,
            positions,
            times=None if frequency is None else uniform_times(1 / frequency, len(positions)),
            names=names,
            part=name,
            unused=unused,
        )
        for name, positions in dataset["demonstrations"].items()
    ]


def _names(widths: dict[str, int]) -> tuple[str, ...]:
    """Return x, y, z for one position, and the name of its observation with a number for all else."""
    if list(widths.values()) == [len(AXIS_NAMES)]:
        return AXIS_NAMES
    return tuple(f"{key}_{i}" for key, width in widths.items() for i in range(width))


def parse(content: bytes, keys: list[str]) -> dict[str, Any]:
    """Return the content of a dataset; runs in the child, so that only the child imports h5py."""
    from skillctl.demonstrations.observations import contents

    return contents(content, keys)
