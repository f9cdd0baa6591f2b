"""The artifact: a skill with its demonstrations and its history, and their form as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import ValidationError

from skillctl.arrays import FloatArray
from skillctl.errors import InvalidModelError
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.golden import GoldenMotions
from skillctl.model.pose import Pose
from skillctl.model.skill import Skill
from skillctl.model.space import Euclidean, Space
from skillctl.store.canonical import dump_canonical, load_strict
from skillctl.store.errors import LaterFeature, Refusal
from skillctl.store.layout import META, Array, content_digest
from skillctl.store.migrations import migrated, require_format
from skillctl.store.schema import (
    WITHOUT_TIDYING,
    DemonstrationReport,
    Meta,
    Operation,
    PoseState,
    Provenance,
    State,
    first_complaint,
    label,
    parse_meta,
)
from skillctl.store.ties import require_ties
from skillctl.store.tree import model_arrays, node_of, skill_of, unknown_gates

HALF_TURN = np.pi * (1 + 2.0**-50)  # [rad]; vectors of rotations by 180° are rounded to a little more or less
# Of a report: of demonstrations that were moved, and of poses.
SOME_HAVE = (
    *("moved", "dtw_unmoved"),
    *("turning_rmse", "dtw_angle", "end_angle", "moved_angle", "dtw_angle_unmoved"),
)


@dataclass(frozen=True, eq=False)
class Artifact:
    """A skill, the demonstrations that its leaves were learned from, and where all of it comes from.

    Attributes:
        skill: The skill.
        demonstrations: One set per leaf, None for a leaf that keeps none. Their velocities are not stored:
            a reader derives them from the positions (``Demonstration.from_positions``).
        operation: The command that made the skill.
        provenance: Inputs, parents, versions.
        reports: How well it repeats each demonstration.
        golden: Motions by which implementations are compared, recorded where the skill was made.
    """

    skill: Skill
    demonstrations: tuple[DemonstrationSet | None, ...]
    operation: Operation
    provenance: Provenance
    reports: tuple[DemonstrationReport, ...] = ()
    golden: GoldenMotions | None = None

    def __post_init__(self) -> None:
        n_leaves = len(self.skill.leaves)
        if len(self.demonstrations) != n_leaves:
            raise InvalidModelError(
                f"demonstrations: {len(self.demonstrations)} sets for a skill of {n_leaves} leaves."
            )
        for leaf, taught in enumerate(self.demonstrations):
            if taught is not None and taught.space != self.skill.space:
                raise InvalidModelError(
                    f"demonstrations of leaf {leaf}: not in the state space of the skill."
                )
        for report in self.reports:
            if report.leaf >= n_leaves:
                raise InvalidModelError(f"report on {report.source}: there is no leaf {report.leaf}.")

    @property
    def taught(self) -> list[Demonstration]:
        """All demonstrations, those of the first leaf first."""
        return [motion for motions in self.demonstrations for motion in motions or ()]

    @cached_property
    def digest(self) -> str:
        """The content digest, ``sha256:…``: one identity for one content."""
        return content_digest(arrays_of(self))


def arrays_of(artifact: Artifact) -> dict[str, Array]:
    """Return the content of an artifact as arrays by path, ``meta.json`` among them.

    Raises:
        InvalidModelError: A text that the format does not allow, such as a name with control characters; an
            operation that does not make such a skill; or states that the format does not allow.
    """
    meta, contents = _meta_of(artifact), contents_of(artifact)
    try:
        require_ties(meta)
        _require_states(artifact.skill.space, contents)
    except Refusal as reason:
        raise InvalidModelError(f"this skill cannot be stored: {reason}.") from None
    text = dump_canonical(_dumped(meta))
    return {**contents, META: np.frombuffer(text, dtype=np.uint8)}


def contents_of(artifact: Artifact) -> dict[str, Array]:
    """Return all arrays of an artifact but its metadata, by path."""
    golden = artifact.golden
    recorded = {} if golden is None else {"golden/times": golden.times, "golden/states": golden.states}
    return {**model_arrays(artifact.skill), **_demonstration_arrays(artifact), **recorded}


def metadata_of(artifact: Artifact) -> dict[str, Any]:
    """Return meta.json of an artifact, as JSON values."""
    return _dumped(_meta_of(artifact))


def _dumped(meta: Meta) -> dict[str, Any]:
    """Return metadata as JSON values, without the keys that only some reports on demonstrations have."""
    value = meta.model_dump(mode="json")
    value["reports"] = [dumped_report(report) for report in meta.reports]
    return value


def dumped_report(report: DemonstrationReport) -> dict[str, Any]:
    """Return a report on a demonstration as JSON values, without the keys that only some have."""
    values = report.model_dump(mode="json")
    return {name: value for name, value in values.items() if value is not None or name not in SOME_HAVE}


def artifact_of(arrays: Mapping[str, Array], name: str, version: int) -> Artifact:
    """Return the artifact that ``arrays`` hold.

    Args:
        arrays: By path.
        name: What the file is called in messages.
        version: The format version that its seal states.

    Raises:
        ArtifactError: Metadata of a format version that is not read.
        LaterFeature: A part of the format that this build cannot use.
        Refusal, InvalidModelError, InputDataError: Contents that break a rule of the format.
    """
    for path, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise Refusal(f"/{path}: must be finite")
    meta = _load_meta(arrays[META], name, version)
    _refuse_reserved(meta)
    space = _space_of(meta.state)
    _require_states(space, arrays)
    skill = skill_of(meta.skill, arrays, space)
    demonstrations = _demonstrations_of(arrays, meta.demonstrations, len(skill.leaves), space)
    golden = None
    if "golden/states" in arrays:
        golden = GoldenMotions(arrays["golden/times"], arrays["golden/states"])
    artifact = Artifact(skill, demonstrations, meta.operation, meta.provenance, meta.reports, golden)
    # The digest by the rules of the file's own format: another format gives another one.
    artifact.__dict__["digest"] = content_digest(arrays, version)
    return artifact


def _load_meta(stored: Array, name: str, version: int) -> Meta:
    try:
        value = load_strict(stored.tobytes())
    except Refusal as reason:
        raise Refusal(f"/{META}: {reason}") from None
    if not isinstance(value, dict):
        raise Refusal(f"/{META}: not an object")
    require_format(name, value.get("format"))
    if value["format"] != version:
        raise Refusal(f"/{META}: format: must be {version}, as its seal states")
    meta = parse_meta(migrated(value, version))
    require_ties(meta, version)
    return meta


def _space_of(state: State) -> Space:
    if isinstance(state, PoseState):
        return Pose(state.names, state.unit, state.frame, state.characteristic_length)
    return Euclidean(state.names, state.unit, state.frame)


def _stated(space: Space) -> dict[str, Any]:
    """Return what metadata says of a space."""
    stated = {"names": space.names, "unit": space.unit, "frame": space.frame, "kind": space.kind}
    return stated | {"characteristic_length": space.length} if isinstance(space, Pose) else stated


def _require_states(space: Space, arrays: Mapping[str, Array]) -> None:
    """Raise Refusal unless the arrays hold states of a space."""
    d = arrays["model/means"].shape[1]
    if isinstance(space, Pose):
        if d != space.dimension:
            raise Refusal(f"/model/means: d is {d}, but a pose has {space.dimension} numbers")
        if (np.linalg.norm(arrays["model/attractors"][:, 3:], axis=1) > HALF_TURN).any():
            raise Refusal("/model/attractors: a rotation vector is longer than half a turn")
    if space.dimension != d or len(set(space.names)) != d:
        raise Refusal(f"/meta.json: state.names: expected {d} different names")
    c = arrays["coordinates/linear"].shape[1] if "coordinates/linear" in arrays else space.positions
    if c != space.positions:
        raise Refusal(f"/coordinates/linear: c is {c}, but a position has {space.positions} coordinates")


def _refuse_reserved(meta: Meta) -> None:
    """Raise LaterFeature for what the format reserves, and this build cannot use."""
    if gates := dict.fromkeys(unknown_gates(meta.skill)):
        raise LaterFeature(" and ".join(f"the gate {gate}" for gate in gates))


def _meta_of(artifact: Artifact) -> Meta:
    space = artifact.skill.space
    try:
        return Meta.model_validate(
            {
                "skill": node_of(artifact.skill),
                "state": _stated(space),
                "operation": artifact.operation,
                "demonstrations": tuple(label(d.source) for _, d in _numbered(artifact)),
                "reports": artifact.reports,
                "provenance": artifact.provenance,
            },
            context=WITHOUT_TIDYING,  # a coordinate must not get another name
        )
    except ValidationError as error:
        raise InvalidModelError(f"this skill cannot be stored: {first_complaint(error)}.") from error


def _numbered(artifact: Artifact) -> list[tuple[int, Demonstration]]:
    """Return every demonstration with the index of its leaf."""
    return [(leaf, d) for leaf, taught in enumerate(artifact.demonstrations) for d in taught or ()]


def _demonstration_arrays(artifact: Artifact) -> dict[str, Array]:
    numbered = _numbered(artifact)
    if not numbered:
        return {}
    return {
        "demonstrations/positions": np.concatenate([d.positions for _, d in numbered]),
        "demonstrations/times": np.concatenate([d.times for _, d in numbered]),
        "demonstrations/offsets": np.cumsum([0] + [d.times.size for _, d in numbered], dtype=np.int64),
        "demonstrations/part": np.array([leaf for leaf, _ in numbered], dtype=np.int64),
    }


def _demonstrations_of(
    arrays: Mapping[str, Array], sources: tuple[str, ...], n_leaves: int, space: Space
) -> tuple[DemonstrationSet | None, ...]:
    if "demonstrations/part" not in arrays:
        if sources:
            raise Refusal("/meta.json: demonstrations: the file holds none")
        return (None,) * n_leaves
    offsets, part = arrays["demonstrations/offsets"], arrays["demonstrations/part"]
    positions: FloatArray = arrays["demonstrations/positions"]
    times: FloatArray = arrays["demonstrations/times"]
    if offsets[0] != 0 or offsets[-1] != len(times) or (offsets[1:] <= offsets[:-1]).any():
        raise Refusal("/demonstrations/offsets: must rise from 0 to the number of samples")
    if part[0] < 0 or part[-1] >= n_leaves or (part[1:] < part[:-1]).any():
        raise Refusal(f"/demonstrations/part: must be leaf numbers below {n_leaves}, in order")
    if len(sources) != len(part):
        raise Refusal(f"/meta.json: demonstrations: expected {len(part)} sources")
    taught: list[list[Demonstration]] = [[] for _ in range(n_leaves)]
    for index, (leaf, source) in enumerate(zip(part, sources, strict=True)):
        rows = slice(offsets[index], offsets[index + 1])
        taught[leaf].append(Demonstration.from_positions(times[rows], positions[rows], source, space))
    return tuple(DemonstrationSet(tuple(members), space) if members else None for members in taught)
