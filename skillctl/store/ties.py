"""How the command, the skill tree and the results of an artifact must fit each other."""

from __future__ import annotations

from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, ValidationError

from skillctl.store.errors import Refusal
from skillctl.store.migrations import FORMAT_VERSION
from skillctl.store.schema import (
    Count,
    Meta,
    NotNegative,
    Operation,
    Positive,
    SedsNode,
    Strict,
    first_complaint,
)

LyapunovOrigin: TypeAlias = Literal["shared", "found", "refitted"]

# The kinds of skill that a command can make; any can be saved from Python.
_MADE = {"learn": ("seds",), "merge": ("merged",), "combine": ("combined",), "chain": ("chain",)}


class _Results(Strict):
    """The results that a command always records; there may be others."""

    model_config = ConfigDict(extra="ignore")


class MergeResults(_Results):
    """Where the common Lyapunov matrix comes from."""

    lyapunov: LyapunovOrigin


class CombineResults(_Results):
    """What the parts keep, and where the Lyapunov matrix comes from if a proof needs a common one."""

    kept: tuple[NotNegative, ...]
    lyapunov: LyapunovOrigin | None = None


class AdaptResults(_Results):
    """What the search chose, how much faster than its parts it is, and the task with its margins."""

    choice: str
    speed: Positive
    task: tuple[str, ...]
    clauses: tuple[str, ...]
    units: tuple[str, ...]
    margins: tuple[float, ...]
    bounds: tuple[float | None, ...]


class HeldOutResults(Strict):
    """What ``learn --validate`` records, as a whole or not at all; see ``skillctl.evaluate.errors``."""

    held_out_demonstrations: Count
    held_out_dtw: NotNegative | None
    held_out_worst_dtw: NotNegative | None
    held_out_arrived: Count
    held_out_dtw_angle: NotNegative | None = None
    held_out_worst_dtw_angle: NotNegative | None = None


_ALWAYS: dict[str, type[BaseModel]] = {
    "merge": MergeResults,
    "combine": CombineResults,
    "adapt": AdaptResults,
}


def require_ties(meta: Meta, version: int = FORMAT_VERSION) -> None:
    """Raise Refusal unless the stated command can have made such a skill and such results.

    Args:
        meta: Metadata that has the form of the schema.
        version: The format of the file: in format 1, what Python made could state any command of its kind,
            without parents and results.
    """
    command, skill = meta.operation.command, meta.skill
    if skill.kind not in _MADE.get(command, (skill.kind,)):
        raise Refusal(f"/meta.json: operation.command: {command} makes no {skill.kind} skill")
    _require_results(meta.operation, may_lack=version == 1)
    if version == 1 or isinstance(skill, SedsNode):
        return
    parts, parents = len(skill.parts), len(meta.provenance.parents)
    one_each = command in ("merge", "chain") and parents != parts
    if one_each or (command == "combine" and not 1 <= parents <= parts):
        raise Refusal(f"/meta.json: provenance.parents: {parents} skills do not {command} into {parts} parts")
    roles = [parent.role for parent in meta.provenance.parents]
    if command == "chain" and roles != [stage_role(number) for number in range(1, parts + 1)]:
        raise Refusal(f"/meta.json: provenance.parents: the roles must be stage 1 to stage {parts}, in order")


def stage_role(number: int) -> str:
    """Return the role of the skill that a stage of a chain was, counted from 1."""
    return f"stage {number}"


def is_complete(operation: Operation) -> bool:
    """Tell whether all results are there that the command records; a file of format 1 may lack some."""
    try:
        _require_results(operation, may_lack=False)
    except Refusal:
        return False
    return True


def _require_results(operation: Operation, *, may_lack: bool) -> None:
    results, record = operation.results, _ALWAYS.get(operation.command)
    held_out = {name: value for name, value in results.items() if "held_out_" in name}
    try:
        if operation.command == "learn" and held_out:
            HeldOutResults.model_validate(held_out)
        elif record is not None:
            record.model_validate(results)
    except ValidationError as error:
        lacking = record is not None and all(fault["type"] == "missing" for fault in error.errors())
        if not (may_lack and lacking):
            raise Refusal(f"/meta.json: operation.results.{first_complaint(error)}") from None
