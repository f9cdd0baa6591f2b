"""Messages between a child process and its parent: two byte strings, behind a header with their lengths.

A request is pickled limits and a pickled call. A child without limits answers with a pickled outcome. A child
with limits handles data of unknown origin, and unpickling its answer could run code: it answers with JSON
text and float64 numbers.
"""

from __future__ import annotations

import json
import pickle
import struct
from collections.abc import Sequence
from math import prod
from typing import IO, Any

from skillctl.errors import InputDataError
from skillctl.workers.limits import Limits

HEADER = struct.Struct("<QQ")
MAX_TEXT = 2**22  # bytes of JSON in one answer
ARRAY = "\0"  # key of an object that stands for an array and holds its shape; no file has such names


def send(stream: IO[bytes], first: bytes, second: Sequence[bytes] = ()) -> None:
    """Write a message; its second byte string may come in pieces."""
    for piece in (HEADER.pack(len(first), sum(map(len, second))), first, *second):
        stream.write(piece)
    stream.flush()


def receive(stream: IO[bytes], limits: Limits | None = None) -> tuple[bytearray, bytearray]:
    """Return the next message.

    Raises:
        EOFError: It breaks off, or there is none.
        ValueError: It is longer than any that a child with these limits sends.
    """
    lengths = HEADER.unpack(_exactly(stream, HEADER.size))
    if limits is not None and (lengths[0] > MAX_TEXT or lengths[1] > limits.numbers):
        raise ValueError("the answer is too long")
    return _exactly(stream, lengths[0]), _exactly(stream, lengths[1])


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    content = bytearray(size)  # memory that arrays can share
    if stream.readinto(content) < size:  # type: ignore[attr-defined]
        raise EOFError
    return content


def result(text: bytearray, numbers: bytearray, limits: Limits | None) -> Any:
    """Return the value in an answer, or raise the exception in it.

    Raises:
        ValueError: No child with limits answers like this, or something else was raised in the child.
    """
    if limits is None:
        value, error, trace = pickle.loads(text)
        if error is not None:
            raise error from Exception(f"in a child:\n{trace}")
        return value
    try:
        answer = _unpacked(text, numbers)
    except (TypeError, RecursionError) as error:
        raise ValueError("the answer makes no sense") from error
    match answer:
        case {"value": value}:
            return value
        case {"refused": str(refusal), "hint": str(hint)}:
            raise InputDataError(refusal, hint=hint)
        case {"exhausted": True}:
            raise MemoryError
        case {"failed": str(reason)}:
            raise ValueError(reason)
    raise ValueError("the answer makes no sense")


def described(error: Exception) -> bytes:
    """Return the answer of a child with limits in which something was raised."""
    if isinstance(error, InputDataError):
        answer: dict[str, Any] = {"refused": str(error), "hint": error.hint}
    elif isinstance(error, MemoryError):
        answer = {"exhausted": True}
    else:
        answer = {"failed": str(error)[:1000] or type(error).__name__}
    return json.dumps(answer).encode()


def packed(value: Any, limits: Limits) -> tuple[bytes, list[bytes]]:
    """Return a value as JSON text, with a shape in place of each array, and the numbers of the arrays."""
    import numpy as np  # late: most children return no arrays

    numbers: list[bytes] = []
    left = limits.numbers

    def shape_of(array: Any) -> dict[str, tuple[int, ...]]:
        nonlocal left
        if not isinstance(array, np.ndarray):
            raise TypeError(f"no {type(array).__name__} can be handed over")
        left -= 8 * array.size
        if left < 0:
            raise ValueError(f"too large: more than {limits.numbers / 2**20:.0f} MiB of numbers")
        numbers.append(array.astype(np.float64).tobytes())
        return {ARRAY: array.shape}

    text = json.dumps({"value": value}, default=shape_of).encode()
    if len(text) > MAX_TEXT:
        raise ValueError(f"it holds more than {MAX_TEXT / 2**20:.0f} MiB of text")
    return text, numbers


def _unpacked(text: bytearray, content: bytearray) -> Any:
    """Return what JSON text says, with its arrays, which come in the order in which they were packed."""
    import numpy as np

    numbers = np.frombuffer(content) if content else np.zeros(0)
    used = 0

    def array_of(item: dict[str, Any]) -> Any:
        nonlocal used
        if ARRAY not in item:
            return item
        start, used = used, used + prod(item[ARRAY])
        return numbers[start:used].reshape(item[ARRAY])

    return json.loads(text, object_hook=array_of)
