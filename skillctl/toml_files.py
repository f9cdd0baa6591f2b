"""TOML files: what they hold, why they cannot be read, or what is wrong in them; and how one is written."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, NotFoundError, did_you_mean, printable
from skillctl.opening import open_regular

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its older name
    import tomli as tomllib

MAX_BYTES = 1 << 20

# How words of pydantic are replaced, in this order.
REWORDED = {
    "Input should be": "must be",
    "String should": "must",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid string": "a text",
    "a valid boolean": "true or false",
    "a valid tuple": "a list",
}


def parse_toml(data: bytes) -> dict[str, Any]:
    """Return the document that the bytes of a TOML file hold.

    Raises:
        ValueError: Not UTF-8, or not TOML.
    """
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # the latter for brackets nested too deeply
        raise ValueError(f"not TOML ({printable(str(error))[:200]})") from None


def toml_lines(values: Mapping[str, str | int]) -> str:
    """Return the lines of a TOML table; keys and texts have no control characters, which TOML does not take.

    Both are few and plain here, so that a review can read them: a library would be more than these lines.
    """
    lines = []
    for key, value in values.items():
        word = json.dumps(key) if "." in key else key  # a bare dot would nest tables
        lines.append(f"{word} = {json.dumps(value, ensure_ascii=False)}\n")  # what JSON escapes, TOML reads
    return "".join(lines)


def read_toml(path: Path, kind: str, hint: str) -> dict[str, Any]:
    """Return the document in a TOML file of a user.

    Args:
        path: The file.
        kind: What it should be, for messages: ``scenario``.
        hint: What to do if it is not.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is no regular file, too long, or not TOML.
    """
    try:
        with open_regular(path) as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise NotFoundError(f"{path}: there is no such file.", hint=hint) from None
    if len(data) > MAX_BYTES:
        raise InputDataError(f"{path}: is no {kind}: it has more than {MAX_BYTES} bytes.", hint=hint)
    try:
        return parse_toml(data)
    except ValueError as error:
        raise InputDataError(f"{path}: is {error}.", hint=hint) from None


def complaint(errors: Sequence[Mapping[str, Any]], known: Collection[str]) -> str:
    """Return the first thing that pydantic found wrong: which key, what was expected, what it is.

    Args:
        errors: Its ``ValidationError.errors()``.
        known: All keys that there are, to suggest one for a misspelt one.
    """
    paths = [_path(error, known) for error in errors]
    about = [error for error, path in zip(errors, paths, strict=True) if path[:1] == paths[0][:1]]
    deepest = max(len(_path(error, known)) for error in about)  # of what a value may be, what it nearly is
    first, *others = (error for error in about if len(_path(error, known)) == deepest)
    steps = _path(first, known)
    number = f"number {steps.pop() + 1} " if len(steps) > 1 and _is_entry(first, steps) else ""
    key = ".".join(map(str, steps))
    match first["type"]:
        case "value_error":  # ours, of a whole table: it names the key within it itself
            separator = ": " if number or not isinstance(first["input"], Mapping) else "."
            said = separator.join([*filter(None, [key]), str(first["ctx"]["error"])])
        case "missing":
            said = f"{key}: {number}is missing."
        case "extra_forbidden":
            meant = did_you_mean(str(steps[-1]), sorted(known))
            said = f"{key}: there is no such key. {meant}".rstrip()
        case _:
            expected = [_expected(error) for error in (first, *others)]
            wanted = " or ".join([expected[0], *(text.removeprefix("must be ") for text in expected[1:])])
            got = "" if isinstance(first["input"], Mapping) else f", got {repr(first['input'])[:80]}"
            said = f"{key}: {number}{wanted}{got}."
    return printable(said)


def _path(error: Mapping[str, Any], known: Collection[str]) -> list[Any]:
    """Return the keys and numbers that lead to a value, without the alternatives that pydantic tried."""
    *steps, last = error["loc"] or ("",)
    kept = [step for step in steps if isinstance(step, int) or step in known]
    if isinstance(last, int) or last in known or error["type"] == "extra_forbidden":
        kept.append(last)
    return kept


def _is_entry(error: Mapping[str, Any], steps: Sequence[Any]) -> bool:
    """Return whether an error is about one entry of a list, and not about a table in one."""
    return isinstance(steps[-1], int) and not error["type"].startswith(("union_tag", "model", "value_error"))


def _expected(error: Mapping[str, Any]) -> str:
    match error["type"]:
        case "union_tag_not_found":
            return "its kind must be given, by the key 'kind'"
        case "union_tag_invalid":
            return f"its kind must be {error['ctx']['expected_tags']}"
        case "model_type" | "model_attributes_type":
            return "must be a table"
        case "too_short":
            return "must not be empty"
        case "too_long":
            return f"must have {error['ctx']['max_length']} entries"
    said: str = error["msg"]
    for pydantic, ours in REWORDED.items():
        said = said.replace(pydantic, ours)
    return said
