"""C source as text: constants, arrays, and a template of which only what is needed is kept."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from textwrap import wrap
from typing import Any

import numpy as np

WIDTH = 108  # of a line
CONDITION = re.compile(r"#if (!?)([A-Z]+)")


def number(value: float) -> str:
    """Return a float64 as C writes it, without a rounding."""
    return "HUGE_VAL" if value == float("inf") else float(value).hex()


def quoted(text: str) -> str:
    """Return a text as a literal: bytes beyond plain characters as octal numbers."""
    plain = (
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in text.encode()
    )
    return f'"{"".join(plain)}"'


def braced(values: Iterable[str]) -> str:
    """Return an initialiser."""
    return f"{{{', '.join(values)}}}"


def constant(kind: str, name: str, values: Any) -> str:
    """Return the definition of an array of numbers, or of rows of them."""
    array = np.asarray(values)
    sizes = "".join(f"[{size}]" for size in array.shape)
    write = str if array.dtype.kind == "i" else number
    rows = array[None] if array.ndim == 1 else array
    lines = [f"{{{', '.join(map(write, row.tolist()))}}}" for row in rows]
    body = lines[0] if array.ndim == 1 else "{" + ",\n".join(lines) + "}"
    return f"static const {kind} {name}{sizes} = {_filled(body)};\n"


def _filled(body: str) -> str:
    return "\n    ".join(part for line in body.split("\n") for part in wrap(line, WIDTH))


def kept(template: str, features: Mapping[str, bool]) -> str:
    """Return a template without what is for other skills.

    Lines ``#if FEATURE``, ``#if !FEATURE``, ``#else`` and ``#endif`` decide, nested as in C. Those which
    the C compiler is to see end in a comment.
    """
    lines, holds = [], [True]
    for line in template.splitlines():
        if condition := CONDITION.fullmatch(line):
            negated, feature = condition.groups()
            holds.append(features[feature] != bool(negated))
        elif line == "#else":
            holds[-1] = not holds[-1]
        elif line == "#endif":
            holds.pop()
        elif all(holds):
            lines.append(line)
    return "\n".join(lines) + "\n"


def named(template: str, prefix: str) -> str:
    """Return a template whose names begin with a prefix instead of ``skill``; ``SKILL_SELFTEST`` stays."""
    lower = re.sub(r"\bskill_", f"{prefix}_", template)
    return re.sub(r"\bSKILL_(?!SELFTEST)", f"{prefix.upper()}_", lower)
