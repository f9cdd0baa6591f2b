"""JSON in one spelling, and a strict reader of it."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from skillctl.store.errors import Refusal

MAX_DEPTH = 64  # brackets inside brackets; Python's own parser would stop only at the stack's end
MAX_DIGITS = 19  # of an integer: as many as int64 needs; longer ones cost quadratic time

_STRING = re.compile(rb'"(?:[^"\\]|\\.)*"?')


def dump_canonical(value: Any) -> bytes:
    """Return ``value`` as ASCII JSON with sorted keys and no spaces; every float reads back exactly.

    Raises:
        ValueError: NaN or infinity, which JSON does not have.
    """
    return json.dumps(value, sort_keys=True, allow_nan=False, separators=(",", ":")).encode("ascii")


def load_strict(text: bytes) -> Any:
    """Return the value of one JSON document, refusing everything that two parsers might read differently.

    Raises:
        Refusal: Not UTF-8, not JSON, something after the document, a key twice, a number that float64 or
            int64 does not hold, or brackets nested too deeply.
    """
    _require_shallow(text)
    try:
        decoded = text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise Refusal(f"not UTF-8 (byte {error.start})") from None
    try:
        return json.loads(
            decoded,
            object_pairs_hook=_object,
            parse_int=_integer,
            parse_float=_float,
            parse_constant=_constant,
        )
    except json.JSONDecodeError as error:
        raise Refusal(f"not JSON ({error.msg}, character {error.pos})") from None


def _require_shallow(text: bytes) -> None:
    depth = 0
    for byte in _STRING.sub(b"", text):
        if byte in b"[{":
            depth += 1
        elif byte in b"]}":
            depth -= 1
        if depth > MAX_DEPTH:
            raise Refusal(f"nested more than {MAX_DEPTH} deep")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise Refusal(f"key {twice[:80]!r} occurs twice")
    return members


def _integer(digits: str) -> int:
    value = int(digits) if len(digits) <= MAX_DIGITS + 1 else 2**63
    if not -(2**63) <= value < 2**63:
        raise Refusal(f"integer of {len(digits)} characters does not fit int64")
    return value


def _float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise Refusal(f"number {digits[:40]} does not fit float64")
    return value


def _constant(name: str) -> float:
    raise Refusal(f"{name} is not JSON")
