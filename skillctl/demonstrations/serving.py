"""What the child of ``child.py`` does: parse files under limits, and answer with numbers and text.

A message, either way, is a frame with two lengths in bytes, then JSON text, then raw bytes: of the file in a
request, of float64 numbers in an answer.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import sys
import time
from collections.abc import Callable
from importlib import import_module
from math import prod
from typing import Any, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import MAX_BYTES
from skillctl.errors import InputDataError

TIME_LIMIT = 8.0  # [s] for one file, including the start of the child for the first
MEMORY_LIMIT = 2**31  # bytes of address space: a file and numbers of MAX_BYTES each, twice, and the libraries
MAX_VALUES = 100_000  # arrays, texts and collections in one file
MAX_TEXT = 2**26  # bytes of JSON in one answer
FRAME = struct.Struct("<QQ")

# A function at the top level of a module: takes the bytes of a file, and options; returns arrays, text and
# numbers in lists and mappings, or raises InputDataError without the name of the file.
Parser: TypeAlias = Callable[..., Any]


def serve() -> None:
    """Answer requests until there are no more: the main function of the child."""
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is no answer
    _restrict()
    while frame := requests.read(FRAME.size):
        size, length = FRAME.unpack(frame)
        request = json.loads(requests.read(size))
        _grant_time()
        answer, arrays = _answer(request, requests.read(length))
        text = json.dumps(answer).encode()
        answers.write(FRAME.pack(len(text), sum(array.nbytes for array in arrays)))
        answers.write(text)
        for array in arrays:
            answers.write(array.tobytes())
        answers.flush()


def _answer(request: Any, content: bytes) -> tuple[dict[str, Any], list[FloatArray]]:
    try:
        parser = getattr(import_module(request["module"]), request["parser"])
        packing = _Packing()
        value = packing.packed(parser(content, **request["options"]))
    except InputDataError as refusal:
        return {"refused": str(refusal), "hint": refusal.hint}, []
    except MemoryError:
        return {"exhausted": True}, []
    except Exception as error:  # the libraries raise a dozen types on damaged files
        return {"failed": str(error)[:1000] or type(error).__name__}, []
    return {"value": value}, packing.arrays


class _Packing:
    """Takes a value apart: into what JSON can hold, and arrays."""

    def __init__(self) -> None:
        self.arrays: list[FloatArray] = []
        self._values = self._bytes = 0

    def packed(self, value: Any) -> Any:
        """Return the value with a shape in place of each array, which goes to ``arrays``."""
        self._values += 1
        if self._values > MAX_VALUES:
            raise ValueError(f"it holds more than {MAX_VALUES} values")
        if isinstance(value, np.ndarray):
            self._bytes += 8 * value.size
            if self._bytes > MAX_BYTES:
                raise ValueError(f"too large: more than {MAX_BYTES / 2**20:.0f} MiB of numbers")
            self.arrays.append(value.astype(np.float64))
            return {"shape": value.shape}
        if isinstance(value, dict):
            return {"items": {str(name): self.packed(item) for name, item in value.items()}}
        return [self.packed(item) for item in value] if isinstance(value, list) else value


def unpacked(value: Any, numbers: bytearray) -> Any:
    """Return the value that the child has packed; its arrays share the memory of ``numbers``."""
    return _unpacked(value, np.frombuffer(numbers) if numbers else np.zeros(0), [0])


def _unpacked(value: Any, numbers: FloatArray, used: list[int]) -> Any:
    if isinstance(value, list):
        return [_unpacked(item, numbers, used) for item in value]
    if not isinstance(value, dict):
        return value
    if "items" in value:
        return {name: _unpacked(item, numbers, used) for name, item in value["items"].items()}
    start, used[0] = used[0], used[0] + prod(value["shape"])
    return numbers[start : used[0]].reshape(value["shape"])


def _restrict() -> None:
    """Limit memory, and allow no writing to files; where the system knows no such limits, go without."""
    with contextlib.suppress(ImportError):
        import resource

        _lower(resource.RLIMIT_AS, MEMORY_LIMIT)
        _lower(resource.RLIMIT_FSIZE, 0)
        _lower(resource.RLIMIT_CORE, 0)


def _grant_time() -> None:
    """Limit the CPU time until the next request: a parent that was killed can stop nothing any more."""
    with contextlib.suppress(ImportError):
        import resource

        _lower(resource.RLIMIT_CPU, int(time.process_time() + TIME_LIMIT) + 1)


def _lower(what: int, most: int) -> None:
    """Set a soft limit, as far as the hard one allows."""
    import resource

    hard = resource.getrlimit(what)[1]
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    with contextlib.suppress(ValueError, OSError):  # some systems know a limit, but refuse to set it
        resource.setrlimit(what, (allowed, hard))
