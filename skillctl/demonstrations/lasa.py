"""The LASA handwriting motions: planar, in millimetres, several per file."""

from __future__ import annotations

from skillctl.demonstrations import matlab
from skillctl.demonstrations.files import File
from skillctl.demonstrations.matlab import Value, Variables, matrix
from skillctl.demonstrations.recording import Recording
from skillctl.errors import InputDataError

FIELDS = ("pos", "vel", "t")


def recognises(file: File) -> bool:
    """Return whether the content is a MATLAB file whose variables are laid out as in the LASA data set."""
    return matlab.recognises(file) and bool(_structs(matlab.variables(file)))


def read(file: File) -> list[Recording]:
    """Return the demonstrations in the cell array ``demos``: structs of pos (d, T), vel (d, T), t (1, T).

    Raises:
        InputDataError: The file has another layout, or lengths do not match.

    References:
        Khansari-Zadeh & Billard 2011, the data set that accompanies SEDS.
    """
    variables, path = matlab.variables(file), file.path
    structs = _structs(variables)
    if not structs:
        expected = "a cell array demos of structs with the fields pos, vel and t"
        raise matlab.other_layout(file, "not laid out as LASA motions", expected)
    recordings = []
    for index, fields in enumerate(structs):
        pos, vel, t = (matrix(fields[name]) for name in FIELDS)
        part = f"demonstration {index}"
        if pos is None or vel is None or t is None or vel.shape != pos.shape or t.size != pos.shape[1]:
            raise InputDataError(
                f"{path}, {part}: pos, vel and t are not matrices of matching lengths.",
                hint="Expected pos (d, T), vel (d, T) and t (1, T).",
            )
        recordings.append(Recording(path, pos.T, times=t.ravel(), velocities=vel.T, part=part, unit="mm"))
    return recordings


def _structs(variables: Variables) -> list[dict[str, Value]]:
    """Return the structs in ``demos``; an empty list if it has another layout."""
    demos = variables.get("demos")
    cells = demos if isinstance(demos, list) else []
    structs = [cell for cell in cells if isinstance(cell, dict) and set(FIELDS) <= set(cell)]
    return structs if len(structs) == len(cells) else []
