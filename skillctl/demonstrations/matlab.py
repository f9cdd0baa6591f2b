"""MATLAB 5 files (``save -v7`` and older): the part of the format that demonstrations need.

Our own reader, because a damaged file must end in a sentence: SciPy's was seen to crash the interpreter.

References:
    MathWorks, MAT-File Format, chapter 1: level 5.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import TypeAlias, Union

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import MAX_BYTES, damaged
from skillctl.demonstrations.recording import listed


@dataclass(frozen=True, slots=True)
class Cells:
    """A cell array, column by column."""

    items: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class Structs:
    """An array of structs, column by column: one mapping from field to value each."""

    items: tuple[dict[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Other:
    """A value that no demonstration is made of: text, sparse, complex, objects."""


Value: TypeAlias = Union[FloatArray, Cells, Structs, Other]  # noqa: UP007 (forward references)
Variables: TypeAlias = dict[str, Value]

MAX_DEPTH = 8  # cells in structs in cells …; demonstrations need three
HEADER = 128  # bytes before the first element
ORDERS = {b"IM": "<", b"MI": ">"}  # end of the header, and the byte order it stands for
MATRIX, COMPRESSED = 14, 15  # kinds of element
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CELL, STRUCT, REAL = 1, 2, range(6, 16)  # classes of array
COMPLEX = 0x800  # flag of an array


def variables(content: bytes, path: Path) -> Variables:
    """Return the variables in the content of a MATLAB 5 file.

    Raises:
        InputDataError: Damaged, or larger than it may be when unpacked.
    """
    try:
        if content[126:HEADER] not in ORDERS:
            raise ValueError("it does not start like one")
        return dict(_variables(content, ORDERS[content[126:HEADER]]))
    except (ValueError, struct.error, zlib.error) as error:
        raise damaged(path, "MATLAB 5 file", error) from error


def described(content: Variables) -> str:
    """Return names and kinds of variables, in words."""
    return listed([f"{name} {_kind(value)}" for name, value in content.items()]) or "no variables"


def _kind(value: Value) -> str:
    return str(value.shape) if isinstance(value, np.ndarray) else type(value).__name__.lower()


def matrix(value: Value | None) -> FloatArray | None:
    """Return a matrix that is not empty, or None if the value is something else."""
    return value if isinstance(value, np.ndarray) and value.ndim == 2 and value.size else None


def _variables(content: bytes, order: str) -> Iterator[tuple[str, Value]]:
    left = MAX_BYTES  # a small file may hide a large one
    for kind, data in _elements(memoryview(content)[HEADER:], order):
        if kind != COMPRESSED:
            inflated = [(kind, data)]
        else:
            unpacker = zlib.decompressobj()
            unpacked = unpacker.decompress(data, max(1, left))  # 0 would mean: no limit
            if unpacker.unconsumed_tail or not unpacker.eof:
                raise ValueError("a compressed variable is cut off, or too large")
            left -= len(unpacked)
            inflated = list(_elements(memoryview(unpacked), order))
        yield from (_array(data, order, MAX_DEPTH) for kind, data in inflated if kind == MATRIX)


def _elements(buffer: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield kind and data of each element; small ones share their tag's eight bytes."""
    position = 0
    while position < len(buffer):
        (word,) = struct.unpack_from(f"{order}I", buffer, position)
        kind, size, start = word & 0xFFFF, word >> 16, position + 4
        following = position + 8
        if size == 0:
            kind, start = word, following
            (size,) = struct.unpack_from(f"{order}I", buffer, position + 4)
            following = start + size + (-size % 8 if kind != COMPRESSED else 0)
        if start + size > len(buffer) or (following == position + 8 and size > 4):
            raise ValueError("an element reaches beyond its end")
        yield kind, buffer[start : start + size]
        position = following


def _array(data: memoryview, order: str, depth: int) -> tuple[str, Value]:
    """Return name and value of one array."""
    if depth == 0:
        raise ValueError("arrays are nested too deeply")
    if not data:
        return "", np.zeros((0, 0))
    (_, head), (_, sizes), (_, letters), *rest = _elements(data, order)
    (flags,) = struct.unpack_from(f"{order}I", head)
    shape = tuple(np.frombuffer(sizes, f"{order}i4").tolist())
    if min(shape, default=0) < 0:
        raise ValueError("an array has a negative size")
    return bytes(letters).decode("latin-1"), _value(flags, shape, rest, order, depth)


def _value(
    flags: int, shape: tuple[int, ...], rest: list[tuple[int, memoryview]], order: str, depth: int
) -> Value:
    """Return the value of an array, by its class; the sizes in its header must match what follows."""
    kind = flags & 0xFF
    if kind in REAL and not flags & COMPLEX:
        ((number, raw),) = rest
        if number not in NUMBERS:
            raise ValueError("an array holds an unknown kind of numbers")
        return np.frombuffer(raw, order + NUMBERS[number]).astype(np.float64).reshape(shape, order="F")
    if kind == CELL:
        return Cells(_nested(rest, prod(shape), order, depth))
    if kind == STRUCT:
        (_, width), (_, letters), *values = rest
        (step,) = struct.unpack_from(f"{order}i", width)
        text = bytes(letters).decode("latin-1")
        fields = [text[i : i + step].split("\0")[0] for i in range(0, len(text), step)]
        items = _nested(values, prod(shape) * len(fields), order, depth)
        rows = (items[i : i + len(fields)] for i in range(0, len(items), max(1, len(fields))))
        return Structs(tuple(dict(zip(fields, row, strict=True)) for row in rows))
    return Other()


def _nested(elements: list[tuple[int, memoryview]], count: int, order: str, depth: int) -> tuple[Value, ...]:
    if len(elements) != count or any(kind != MATRIX for kind, _ in elements):
        raise ValueError("an array's header claims other contents than it has")
    return tuple(_array(data, order, depth - 1)[1] for _, data in elements)
