"""How the outcome of a call travels from a child to its parent.

From a child without limits it travels pickled. A child with limits handles data that nobody vouches for, and
unpickling what it sends could run code; its answer is JSON text and the bytes of float64 numbers, behind a
header with the length of both.
"""

from __future__ import annotations

import json
import pickle
import struct
import traceback
from dataclasses import dataclass
from math import prod
from typing import IO, Any

from skillctl.errors import InputDataError
from skillctl.workers.limits import Limits

HEADER = struct.Struct("<QQ")
MAX_TEXT = 2**22  # bytes of JSON in one answer
ARRAY = "\0"  # key of an object that stands for an array and holds its shape; no file has such names


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a call returned, or the exception that it raised, with its traceback as text if there is one."""

    value: Any = None
    error: Exception | None = None
    trace: str = ""

    @classmethod
    def failed(cls, error: Exception) -> Outcome:
        """Return the outcome of a call that raised an exception, which is being handled."""
        return cls(error=error, trace=traceback.format_exc())

    def result(self) -> Any:
        """Return the value, or raise the exception."""
        if self.error is not None:
            raise self.error from (Exception(f"in a child:\n{self.trace}") if self.trace else None)
        return self.value


def write(stream: IO[bytes], outcome: Outcome, limits: Limits | None) -> None:
    """Write the outcome of a call, in the child. One that cannot travel is replaced by the reason."""
    parts = _pickled(outcome) if limits is None else _plain(outcome, limits)
    for part in parts:
        stream.write(part)
    stream.flush()


def read(stream: IO[bytes], limits: Limits | None) -> Outcome:
    """Return the outcome of a call, in the parent.

    Raises:
        EOFError: It breaks off.
        ValueError: It is none.
    """
    if limits is None:
        outcome: Outcome = pickle.load(stream)  # we trust this child
        return outcome
    size, count = HEADER.unpack(exactly(stream, HEADER.size))
    if size > MAX_TEXT or count > limits.numbers:
        raise ValueError("no answer is that long")
    text, numbers = exactly(stream, size), exactly(stream, count)
    try:
        answer = _with_arrays(text, numbers)
    except (TypeError, RecursionError) as error:
        raise ValueError("no answer looks like this") from error
    match answer:
        case {"value": value}:
            return Outcome(value)
        case {"refused": str(refusal), "hint": str(hint)}:
            return Outcome(error=InputDataError(refusal, hint=hint))
        case {"exhausted": True}:
            return Outcome(error=MemoryError())
        case {"failed": str(reason)}:
            return Outcome(error=ValueError(reason))
    raise ValueError("no answer looks like this")


def exactly(stream: IO[bytes], size: int) -> bytes:
    """Return the next ``size`` bytes of a stream.

    Raises:
        EOFError: There are fewer.
    """
    content = stream.read(size)
    if len(content) < size:
        raise EOFError
    return content


def _pickled(outcome: Outcome) -> list[bytes]:
    try:
        return [pickle.dumps(outcome)]
    except Exception as error:  # what a result holds may raise anything when it is pickled
        return [pickle.dumps(Outcome(error=TypeError(f"the outcome cannot be pickled: {error}")))]


def _plain(outcome: Outcome, limits: Limits) -> list[bytes]:
    """Return header, text and numbers of an outcome."""
    try:
        if outcome.error is not None:
            raise outcome.error
        text, numbers = _packed(outcome.value, limits.numbers)
    except Exception as error:  # of the call, or no memory, too much, or nothing that JSON knows
        text, numbers = json.dumps(_described(error)).encode(), []
    return [HEADER.pack(len(text), sum(map(len, numbers))), text, *numbers]


def _packed(value: Any, most: int) -> tuple[bytes, list[bytes]]:
    """Return a value as JSON text, with a shape in place of each array, and the numbers of the arrays."""
    import numpy as np  # late: most users of a child hand over none

    numbers: list[bytes] = []
    left = most

    def shape_of(array: Any) -> dict[str, tuple[int, ...]]:
        nonlocal left
        if not isinstance(array, np.ndarray):
            raise TypeError(f"no {type(array).__name__} can be handed over")
        left -= 8 * array.size
        if left < 0:
            raise ValueError(f"too large: more than {most / 2**20:.0f} MiB of numbers")
        numbers.append(array.astype(np.float64).tobytes())
        return {ARRAY: array.shape}

    text = json.dumps({"value": value}, default=shape_of).encode()
    if len(text) > MAX_TEXT:
        raise ValueError(f"it holds more than {MAX_TEXT / 2**20:.0f} MiB of text")
    return text, numbers


def _described(error: Exception) -> dict[str, Any]:
    if isinstance(error, InputDataError):
        return {"refused": str(error), "hint": error.hint}
    if isinstance(error, MemoryError):
        return {"exhausted": True}
    return {"failed": str(error)[:1000] or type(error).__name__}


def _with_arrays(text: bytes, content: bytes) -> Any:
    """Return the value of JSON text, with arrays in the order in which they were packed."""
    import numpy as np

    numbers = np.frombuffer(bytearray(content)) if content else np.zeros(0)  # writable, as arrays are
    used = 0

    def array_of(item: dict[str, Any]) -> Any:
        nonlocal used
        if ARRAY not in item:
            return item
        start, used = used, used + prod(item[ARRAY])
        return numbers[start:used].reshape(item[ARRAY])

    return json.loads(text, object_hook=array_of)
