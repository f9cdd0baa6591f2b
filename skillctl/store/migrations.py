"""The versions of the format: the one that is written, and how older ones are read.

To open format 3: raise ``FORMAT_VERSION``, describe the new form in ``schema`` and ``layout``, and add to
``_STEPS`` the function that turns the metadata of format 2 into it. `tests/archives` keeps files of each.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from skillctl.store.errors import InvalidArtifactError, Refusal, TooNewFormatError, TooOldFormatError

FORMAT_VERSION: Final = 2  # what is written
READABLE_FORMATS = tuple(range(1, FORMAT_VERSION + 1))  # for ever
_READS = f"this build reads formats {', '.join(map(str, READABLE_FORMATS))}"


def mark_of(version: int) -> bytes:
    """Return what the root group of a body states, and what its content digest begins with."""
    return f"skill-v{version}".encode("ascii")


def require_format(name: str, found: object) -> None:
    """Raise unless ``found`` is a format version that this build reads.

    Raises:
        TooNewFormatError, TooOldFormatError: Another whole number.
        InvalidArtifactError: Missing, or not a whole number.
    """
    if type(found) is not int:  # True is an int, too
        shown = "no format version" if found is None else f"format version {str(found)[:40]!r}"
        raise InvalidArtifactError(name, f"it states {shown}, not a whole number; {_READS}")
    if found not in READABLE_FORMATS:
        error = TooNewFormatError if found > FORMAT_VERSION else TooOldFormatError
        raise error(name, f"{found}; {_READS}")


def migrated(meta: dict[str, Any], version: int) -> dict[str, Any]:
    """Return metadata of a format version in the form of the current one.

    Other faults in it are left as they are, for the schema of the current form to find.

    Args:
        meta: What meta.json holds, not checked yet.
        version: The format it was written in.

    Raises:
        Refusal: Something that this format version does not have.
    """
    for step in _STEPS[version - 1 :]:
        meta = step(meta)
    return {**meta, "format": FORMAT_VERSION}


def _from_1_to_2(meta: dict[str, Any]) -> dict[str, Any]:
    """Format 1: every merged node has a sharpness; a skill made in Python has the command of its kind."""
    _require_known(meta.get("state"), "state", "kind", ("euclidean",))
    _require_known(meta.get("operation"), "operation", "command", ("learn", "merge", "combine"))
    changed = {**meta, "skill": _node_from_1(meta.get("skill"))}
    operation = meta.get("operation")
    if isinstance(operation, dict) and operation.get("options") == {"from_python": True}:
        changed["operation"] = {**operation, "command": "python", "options": {}}
    return changed


# What there was in format 1, by kind of skill.
_GATES_OF_1 = {
    "seds": (),
    "merged": ("superposition", "density", "experts"),
    "combined": ("latched", "instantaneous"),
}


def _node_from_1(node: Any) -> Any:
    _require_known(node, "skill", "kind", tuple(_GATES_OF_1))
    if not isinstance(node, dict) or not isinstance(node.get("kind"), str):
        return node
    _require_known(node, "skill", "gate", _GATES_OF_1[node["kind"]])
    changed = dict(node)
    if isinstance(node.get("parts"), list):
        changed["parts"] = [_node_from_1(part) for part in node["parts"]]
    if node["kind"] == "merged":
        sharpness = changed.pop("sharpness", None)
        if type(sharpness) not in (int, float) or not sharpness >= 1:
            raise Refusal("/meta.json: skill: sharpness: must be a number of at least 1")
        if "parameters" in node:
            raise Refusal("/meta.json: skill: parameters: not part of format 1")
        changed["parameters"] = {"sharpness": sharpness} if node.get("gate") == "experts" else {}
    return changed


def _require_known(holder: Any, where: str, key: str, known: tuple[str, ...]) -> None:
    """Refuse a value that came with a later format; the schema refuses what is not a text."""
    value = holder.get(key) if isinstance(holder, dict) else None
    if isinstance(value, str) and value not in known:
        raise Refusal(f"/meta.json: {where}.{key}: format 1 has {', '.join(known) or 'none'} here")


_STEPS: tuple[Callable[[dict[str, Any]], dict[str, Any]], ...] = (_from_1_to_2,)
