"""MATLAB 5 files (``save -v7`` and older), read by SciPy in a child process."""

from __future__ import annotations

from io import BytesIO
from typing import Any, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import listed
from skillctl.errors import InputDataError

# Numbers; a cell array or an array of structs, column by column; one struct; or None for what demonstrations
# do not contain: text, sparse and complex matrices, objects.
Value: TypeAlias = FloatArray | list["Value"] | dict[str, "Value"] | None
Variables: TypeAlias = dict[str, Value]

VERSION_5 = (b"\x00\x01IM", b"\x01\x00MI")  # version and byte order at the end of the header
MAX_DEPTH = 8  # cells in structs in cells …; demonstrations need three
NUMBERS = "fiub"  # kinds of dtype; MATLAB's logical arrays are numbers, too


def recognises(file: File) -> bool:
    """Return whether the content is a MATLAB 5 file."""
    return file.content[124:128] in VERSION_5


def variables(file: File) -> Variables:
    """Return the variables in a MATLAB 5 file.

    Raises:
        InputDataError: The file is damaged, or too large when unpacked.
    """
    parsed: Variables = file.parsed(parse, "MATLAB 5 file")
    return parsed


def other_layout(file: File, what: str, expected: str) -> InputDataError:
    """Return the refusal of a MATLAB file without demonstrations in the expected layout."""
    holds = described(variables(file))
    return InputDataError(f"{file.path}: {what} (found {holds}).", hint=f"Expected {expected}.")


def parse(content: bytes) -> Variables:
    """Return the variables; runs in the child."""
    from scipy.io import loadmat

    loaded = loadmat(BytesIO(content))  # type: ignore[arg-type]  # it reads open files, too
    return {name: _value(value, MAX_DEPTH) for name, value in loaded.items() if not name.startswith("__")}


def _value(value: Any, depth: int) -> Value:
    if depth == 0:
        raise ValueError("arrays are nested too deeply")
    if type(value) is not np.ndarray:  # sparse matrices, and arrays that stand for objects and functions
        return None
    if value.dtype.names is not None:
        structs: list[Value] = [
            {name: _value(fields[name], depth - 1) for name in value.dtype.names}
            for fields in value.ravel(order="F")
        ]
        return structs[0] if len(structs) == 1 else structs
    if value.dtype == object:
        return [_value(item, depth - 1) for item in value.ravel(order="F")]
    return value if value.dtype.kind in NUMBERS else None


def described(content: Variables) -> str:
    """Return a list of the variables with their kinds, for messages."""
    return listed([f"{name} {_kind(value)}" for name, value in content.items()]) or "no variables"


def _kind(value: Value) -> str:
    if isinstance(value, np.ndarray):
        return str(value.shape)
    if isinstance(value, list):
        return "cells"
    return "struct" if isinstance(value, dict) else "other"


def matrix(value: Value) -> FloatArray | None:
    """Return a matrix that is not empty, or None if the value is something else."""
    return value if isinstance(value, np.ndarray) and value.ndim == 2 and value.size else None
