"""What is wrong with a scenario, as one sentence."""

from __future__ import annotations

from collections.abc import Collection

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from skillctl.errors import did_you_mean, printable

KINDS = {"shelf", "table", "push", "move-target", "displace"}  # pydantic's steps, not keys


def in_words(error: ValidationError, known: Collection[str]) -> str:
    """Return the first thing that is wrong as one sentence: which key, what was expected, what it is.

    Args:
        error: Of a scenario.
        known: All keys that there are, to suggest one for a misspelt one.
    """
    found = error.errors(include_url=False)
    first = next((e for e in found if e["loc"][:2] != ("target", "literal['cup']")), found[0])
    steps = [step for step in first["loc"] if step not in KINDS and "[" not in str(step)]
    number = ""
    if len(steps) > 1 and isinstance(steps[-1], int) and steps[-2] != "disturbances":
        number = f"number {steps.pop() + 1} "  # type: ignore[operator]  # it is an int
    key = printable(".".join(map(str, steps)))
    if first["type"] == "value_error":  # ours, of a whole table: it names the key within it itself
        return ".".join([*filter(None, [key]), str(first["ctx"]["error"])])
    if first["type"] == "extra_forbidden":
        return f"{key}: there is no such key. {did_you_mean(str(steps[-1]), sorted(known))}".rstrip()
    if first["type"] == "missing":
        return f"{key}: {number}is missing."
    if key == "target" and isinstance(first["input"], str):
        return f"target: must be cup, or numbers, got {_shown(first['input'])}."
    given = "" if isinstance(first["input"], dict) else f", got {_shown(first['input'])}"
    return f"{key}: {number}{_expected(first)}{given}."


def _expected(detail: ErrorDetails) -> str:
    match detail["type"]:
        case "union_tag_not_found" | "union_tag_invalid":
            choices = detail["ctx"].get("expected_tags", "named by the key 'kind'")
            return f"its kind must be {choices}".replace("must be named", "must be given, named")
        case "model_type" | "model_attributes_type":
            return "must be a table"
        case "tuple_type":
            return "must be a list of numbers"
        case "too_short":
            return "must not be empty"
        case "too_long":
            return f"must have {detail['ctx']['max_length']} numbers"
    return detail["msg"].replace("Input should be", "must be")


def _shown(value: object) -> str:
    return printable(repr(value))[:80]
