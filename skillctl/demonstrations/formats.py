"""Which format a file has, judged by its content, and the reader of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from skillctl.demonstrations import archive, lasa, lpvds, matlab, robomimic, table, tum
from skillctl.demonstrations.child import Child
from skillctl.demonstrations.recording import Recording
from skillctl.errors import InputDataError

FORMATS = ("csv", "tum", "npz", "robomimic", "lasa", "lpvds")  # what ``input_format`` may force
MATLAB_5 = (b"\x00\x01IM", b"\x01\x00MI")  # version and byte order at the end of the header
FOREIGN = {  # first bytes of what people hand over by mistake, and what to do then
    b"\x89SKILL": ("a skill, not a demonstration", "Look into it with: skillctl inspect"),
    b"MATLAB 7.3": ("a MATLAB 7.3 file, which is not read", "Save it in MATLAB with: save -v7"),
    b"\x93NUMPY": (
        "a single NumPy array",
        "Save it with times or dt: numpy.savez(file, positions=..., dt=...)",
    ),
    b"\x1f\x8b": ("compressed with gzip", "Unpack it with: gunzip"),
    b"\xff\xfe": ("UTF-16 text", "Save it as UTF-8."),
    b"\xfe\xff": ("UTF-16 text", "Save it as UTF-8."),
    b"%PDF": ("a PDF document", "Name a demonstration file."),
    b"\x89PNG": ("a picture", "Name a demonstration file."),
}


def recordings_in(
    content: bytes,
    path: Path,
    child: Child,
    input_format: str | None = None,
    columns: Sequence[str] | None = None,
) -> tuple[str, list[Recording]]:
    """Return the name of the format and the recordings in the content of a file.

    Args:
        content: The bytes of the file.
        path: Where they come from, for messages.
        child: Parses what only large libraries in C can.
        input_format: One of ``FORMATS``; by default told from the content.
        columns: Position columns; formats without names of their own leave them to the caller.

    Raises:
        InputDataError: Damaged, or no format of these.
    """
    importer = input_format or _format_by_signature(content, path)
    if importer == "csv":
        return importer, table.read(content, path, columns)
    if importer == "tum":
        return importer, tum.read(content, path, columns)
    if importer == "npz":
        return importer, archive.read(content, path)
    if importer == "robomimic":
        return importer, robomimic.read(child, content, path, columns)
    return _from_matlab(matlab.variables(child, content, path), path, importer)


def _format_by_signature(content: bytes, path: Path) -> str:
    """Return one of FORMATS, or mat for those two that are MATLAB files, judging by the first bytes."""
    if content.startswith(b"PK\x03\x04"):
        return "npz"
    if content.startswith(b"\x89HDF"):
        return "robomimic"
    if content[124:128] in MATLAB_5:
        return "mat"
    for start, (what, hint) in FOREIGN.items():
        if content.startswith(start):
            raise InputDataError(f"{path}: {what}.", hint=hint)
    if b"\0" in content:
        raise InputDataError(
            f"{path}: neither text nor a format that skillctl knows.",
            hint="Demonstrations are read from CSV, TUM, NPZ, robomimic HDF5, LASA and LPV-DS .mat files.",
        )
    return "tum" if tum.recognises(content) else "csv"


def _from_matlab(variables: matlab.Variables, path: Path, importer: str) -> tuple[str, list[Recording]]:
    """Read the variables of a MATLAB file as ``importer`` says, or by their layout if it says ``mat``."""
    if importer == "lasa" or (importer == "mat" and lasa.recognises(variables)):
        return "lasa", lasa.read(variables, path)
    if importer == "lpvds" or lpvds.recognises(variables):
        return "lpvds", lpvds.read(variables, path)
    raise InputDataError(
        f"{path}: a MATLAB file of unknown layout (found {matlab.described(variables)}).",
        hint="Expected demos (LASA: structs of pos, vel, t) or data (LPV-DS: matrices [x; dx/dt]).",
    )
