"""Demonstrations of DAMM and later LPV-DS work: poses of a hand with times, converted from bags."""

from __future__ import annotations

from skillctl.demonstrations import matlab
from skillctl.demonstrations.files import File
from skillctl.demonstrations.matlab import matrix
from skillctl.demonstrations.recording import Orientation, Recording
from skillctl.errors import InputDataError

NAME = "data_ee_pose"
ROWS = 8  # x, y, z [m], the quaternion x, y, z, w, and the time [s]


def recognises(file: File) -> bool:
    """Return whether the content is a MATLAB file with a cell array of poses."""
    return matlab.recognises(file) and isinstance(matlab.variables(file).get(NAME), list | dict)


def read(file: File) -> list[Recording]:
    """Return the demonstrations in the cells ``data_ee_pose``: structs with ``pose`` (8, T).

    Raises:
        InputDataError: The file has another layout.

    References:
        Sun, Gao, Li & Figueroa 2024, the data that accompanies DAMM; its quaternions are x, y, z, w, as in
        the bags that it was converted from.
    """
    cells = matlab.variables(file).get(NAME)
    cells = [cells] if isinstance(cells, dict) else cells
    expected = f"a cell array {NAME} of structs with pose (8, T): x, y, z, the quaternion, and the time"
    if not isinstance(cells, list):
        raise matlab.other_layout(file, "not laid out as DAMM demonstrations", expected)
    recordings = []
    for index, cell in enumerate(cells):
        pose, part = matrix(cell.get("pose")) if isinstance(cell, dict) else None, f"demonstration {index}"
        if pose is None or len(pose) != ROWS:
            raise InputDataError(f"{file.path}, {part}: no matrix of poses.", hint=f"Expected {expected}.")
        turn = Orientation(pose[3:7].T, "xyzw", (f"rows 3 to 6 of {NAME}",))
        recordings.append(Recording(file.path, pose[:3].T, times=pose[-1], part=part, orientation=turn))
    return recordings
