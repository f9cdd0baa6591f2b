"""meta.json: what an artifact says about its arrays, and the checks that it must pass."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from skillctl.errors import UsageError, printable
from skillctl.model.chained import EVENT
from skillctl.model.gates import MERGE_GATES, gate_parameters
from skillctl.store.errors import Refusal
from skillctl.store.migrations import FORMAT_VERSION

MAX_LABEL = 200
MAX_TEXT = 1000
WITHOUT_TIDYING = {"tidy": False}  # validation context


class Strict(BaseModel):
    """Frozen; nothing missing, nothing extra, no value of a similar type, no NaN or infinity.

    Texts and facts that a program gives are converted to what metadata allows (``label``, ``plain_facts``),
    so that an unusual file name never stops a command; a file with others is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def label(text: str) -> str:
    """Return ``text`` as metadata may hold it: printable, and only its end if it is too long."""
    return printable(text)[-MAX_LABEL:]


def plain_facts(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return options or results as metadata can hold them: plain numbers, tuples, and printable texts.

    NumPy's numbers and arrays become Python's, NaN and infinity become None, and a path its name.

    Raises:
        TypeError: Anything else that JSON does not have, or a sequence of sequences.
    """
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return tuple(map(_plain_scalar, value)) if isinstance(value, list | tuple) else _plain_scalar(value)


def _plain_scalar(value: Any) -> Any:
    if isinstance(value, PurePath):
        value = value.name
    if isinstance(value, str):
        return printable(value)[:MAX_TEXT]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int):
        return value
    raise TypeError(f"metadata cannot hold {type(value).__name__}")


def _tidied(tidy: Callable[[Any], Any], kind: type) -> BeforeValidator:
    """Convert what a program records; what a file says is not converted."""

    def validate(value: Any, info: ValidationInfo) -> Any:
        return tidy(value) if info.context is not WITHOUT_TIDYING and isinstance(value, kind) else value

    return BeforeValidator(validate)


def _is_printable(text: str) -> str:
    if printable(text) != text:
        raise ValueError("must not contain control characters")
    return text


def is_relative(path: str) -> bool:
    """Return whether no system takes a path for one that is absolute or leads upwards."""
    return re.match(r"[/\\]|[A-Za-z]:", path) is None and ".." not in re.split(r"[/\\]", path)


def _require_relative(path: str) -> str:
    if not is_relative(path):
        raise ValueError("must be a relative path that does not lead upwards")
    return path


Label = Annotated[str, _tidied(label, str), Field(max_length=MAX_LABEL), AfterValidator(_is_printable)]
Text = Annotated[str, Field(max_length=MAX_TEXT), AfterValidator(_is_printable)]
Note = Annotated[Text, Field(min_length=1)]
Name = Annotated[Label, Field(min_length=1)]
RelativePath = Annotated[Name, AfterValidator(_require_relative)]
Key = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}\z")]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}\z")]
ContentDigest = Annotated[str, Field(pattern=r"^sha256:[0-9a-f]{64}\z")]
Date = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ\z")]
Event = Annotated[str, Field(pattern=rf"^{EVENT.pattern}\z")]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]

# JSON has one kind of list; strict tuples would refuse it. What is inside stays strict.
Range = Annotated[tuple[Count, Count], Field(strict=False)]  # first index, and one past the last
Weights = Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]
Scalar = bool | Annotated[int, Field(ge=-(2**63), lt=2**63)] | float | Text | None
# Inside a union, older pydantic ignores that a tuple is not strict, so lists are converted by hand.
Value = Annotated[
    Scalar | tuple[Scalar, ...], BeforeValidator(lambda v: tuple(v) if isinstance(v, list) else v)
]
Facts = Annotated[dict[Key, Value], _tidied(plain_facts, Mapping)]


class SedsNode(Strict):
    """A SEDS skill: which rows of the stacked arrays are its own."""

    kind: Literal["seds"] = "seds"
    leaf: Count
    components: Range
    density: Range
    speed: Positive


class MergedNode(Strict):
    """Skills that act together; see ``skillctl.model.MergedSkill``."""

    kind: Literal["merged"] = "merged"
    parts: Parts
    part_weights: Weights
    gate: Key
    parameters: dict[Key, float]
    speed: Positive

    @model_validator(mode="after")
    def _has_the_parameters_of_its_gate(self) -> MergedNode:
        known = {gate.name: gate for gate in MERGE_GATES}
        if self.gate not in known:  # of a later build; ``artifact`` refuses to use it
            return self
        try:
            complete = gate_parameters(known[self.gate], self.parameters)
        except UsageError as error:
            raise ValueError(str(error).rstrip(".")) from None
        if complete.keys() != self.parameters.keys():
            raise ValueError(f"parameters: expected {', '.join(complete)}")
        return self


class CombinedNode(Strict):
    """Skills of which one acts at a time; see ``skillctl.model.CombinedSkill``."""

    kind: Literal["combined"] = "combined"
    parts: Parts
    part_priors: Weights
    gate: Key
    disturbance_distance: Positive
    speed: Positive


class ChainNode(Strict):
    """Skills that act one after the other; see ``skillctl.model.ChainedSkill``."""

    kind: Literal["chain"] = "chain"
    parts: Annotated[tuple[StageNode, ...], Field(strict=False, min_length=1)]
    levels: Weights
    events: Annotated[tuple[Annotated[tuple[Event, ...], Field(strict=False)], ...], Field(strict=False)]
    on_jump: Literal["stay", "back"]
    disturbance_distance: Positive

    @model_validator(mode="after")
    def _has_a_level_and_events_for_each_part(self) -> ChainNode:
        if not len(self.levels) == len(self.events) == len(self.parts):
            raise ValueError("levels, events: expected one a part")
        return self


PartNode = Annotated[SedsNode | MergedNode, Field(discriminator="kind")]
Parts = Annotated[tuple[PartNode, ...], Field(strict=False, min_length=1)]
StageNode = Annotated[SedsNode | MergedNode | CombinedNode, Field(discriminator="kind")]
Node = Annotated[SedsNode | MergedNode | CombinedNode | ChainNode, Field(discriminator="kind")]


class EuclideanState(Strict):
    """What the numbers of a state mean; see ``skillctl.model.space.Euclidean``."""

    names: Annotated[tuple[Name, ...], Field(strict=False, min_length=1)]
    unit: Literal["m", "rad"]
    frame: Name
    kind: Literal["euclidean"] = "euclidean"


class PoseState(Strict):
    """What the six numbers of a pose mean; see ``skillctl.model.pose.Pose``; its ``length`` is [m/rad]."""

    names: Annotated[tuple[Name, ...], Field(strict=False, min_length=6, max_length=6)]
    unit: Literal["m"]
    frame: Name
    kind: Literal["pose"] = "pose"
    characteristic_length: Positive


State = Annotated[EuclideanState | PoseState, Field(discriminator="kind")]


class Operation(Strict):
    """The command that made the skill.

    Attributes:
        command: Its name; ``python`` if the skill was made or changed in Python, and saved.
        options: Every option that the result depends on, by its long name with underscores.
        seed: Of all random numbers; None if none were drawn.
        results: Results for people and reports: errors, iterations, warnings.
        note: A text of its maker.
    """

    command: Literal["learn", "merge", "combine", "python", "adapt", "chain"]
    options: Facts = {}
    seed: Count | None = None
    results: Facts = {}
    note: Note | None = None


class DemonstrationReport(Strict):
    """How well the skill repeats one demonstration; None if a number was not computed.

    Attributes:
        source: Where the demonstration came from.
        leaf: The SEDS skill of the tree that was learned from it.
        n_points: Samples used.
        duration: [s].
        velocity_rmse: Root mean square of the velocity error along it, [unit/s].
        dtw: Mean distance after dynamic time warping of its rollout, [unit].
        end_error: Distance of the rollout's end from the attractor, [unit].
        arrived: Whether the rollout reached the attractor.
        moved: How far it was moved before it was learned, so that it ends at the target, [unit].
        dtw_unmoved: As ``dtw``, with the demonstration as it was recorded, and a rollout from its start.
        turning_rmse, dtw_angle, end_angle, moved_angle, dtw_angle_unmoved: The same of the orientation, in
            [rad/s] and [rad]; those above are then of the position alone.
    """

    source: Label
    leaf: Count
    n_points: Annotated[int, Field(ge=2, lt=2**63)]
    duration: Positive
    velocity_rmse: NotNegative | None = None
    dtw: NotNegative | None = None
    end_error: NotNegative | None = None
    arrived: bool | None = None
    moved: NotNegative | None = None
    dtw_unmoved: NotNegative | None = None
    turning_rmse: NotNegative | None = None
    dtw_angle: NotNegative | None = None
    end_angle: NotNegative | None = None
    moved_angle: NotNegative | None = None
    dtw_angle_unmoved: NotNegative | None = None


class InputRecord(Strict):
    """A file that was read: its relative path, the SHA-256 of its bytes, and what read it."""

    path: RelativePath
    sha256: Sha256
    importer: Name


class ParentRecord(Strict):
    """A skill this one was made from: how it was named, its version and identity, and its role."""

    name: Name
    version: Annotated[int, Field(ge=1, lt=10**6)] | None = None
    digest: ContentDigest
    role: Name

    @property
    def shown(self) -> str:
        """``name@3``, or the name of a file."""
        return self.name if self.version is None else f"{self.name}@{self.version}"


class Provenance(Strict):
    """Where a skill comes from: no host, no user, no absolute path; a date only if one was set.

    Attributes:
        inputs: Files read, in the order given.
        parents: Skills used, in the order given.
        tool: Version of skillctl.
        libraries: Versions of the libraries that computed the numbers.
        date: From SOURCE_DATE_EPOCH, UTC.
    """

    inputs: Annotated[tuple[InputRecord, ...], Field(strict=False)] = ()
    parents: Annotated[tuple[ParentRecord, ...], Field(strict=False)] = ()
    tool: Name
    libraries: dict[Name, Name] = {}
    date: Date | None = None


class Meta(Strict):
    """The whole of meta.json."""

    format: Literal[2] = FORMAT_VERSION
    skill: Node
    state: State
    operation: Operation
    demonstrations: Annotated[tuple[Label, ...], Field(strict=False)] = ()  # source of each
    reports: Annotated[tuple[DemonstrationReport, ...], Field(strict=False)] = ()
    provenance: Provenance


def metadata_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of meta.json."""
    generated = Meta.model_json_schema()
    # The end of a text is a backslash and z to pydantic, but "$" in JavaScript's expressions, which JSON
    # Schema's are.
    schema = json.loads(json.dumps(generated).replace("\\\\z", "$"))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": f"meta.json of a skill artifact, format {FORMAT_VERSION}",
    }


def parse_meta(value: Any) -> Meta:
    """Return the checked metadata, or raise Refusal naming the first field that is wrong."""
    try:
        return Meta.model_validate(value, context=WITHOUT_TIDYING)
    except ValidationError as error:
        raise Refusal(f"/meta.json: {first_complaint(error)}") from None


def first_complaint(error: ValidationError) -> str:
    """Return where and why validation failed first, without quoting the value."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    where = ".".join(str(step) for step in first["loc"])
    what = first["msg"].removeprefix("Value error, ")[:MAX_LABEL]
    return f"{where[:MAX_LABEL]}: {what}" if where else what
