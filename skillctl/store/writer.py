"""An artifact as bytes: the same content gives the same bytes, in any process."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO

import numpy as np

from skillctl.errors import StoreError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.store.artifact import Artifact, arrays_of, dumped_report
from skillctl.store.canonical import dump_canonical
from skillctl.store.errors import Refusal
from skillctl.store.files import MAX_FILE_BYTES
from skillctl.store.hdf5 import h5py
from skillctl.store.layout import ARRAYS, MAX_LENGTHS, META, Array, content_digest, require_layout
from skillctl.store.migrations import FORMAT_VERSION, mark_of
from skillctl.store.schema import DemonstrationReport, Operation, Provenance, label
from skillctl.store.seal import SEAL_BYTES, seal
from skillctl.store.tree import node_of

_FEW_DIGITS = 0.1234567890123456  # most floats have one more, and errors begin with zeros
TOO_LARGE = "Learn it, or its parts, from fewer demonstrations (--demos) or with fewer --components."


def encode(artifact: Artifact) -> bytes:
    """Return the sealed file of an artifact.

    Raises:
        InvalidModelError: A text that the format does not allow.
        StoreError: Larger than an artifact may be.
    """
    arrays = arrays_of(artifact)
    _require_metadata_fits(arrays[META].size, len(artifact.reports))
    try:
        require_layout({path: array.shape for path, array in arrays.items()})
    except Refusal as reason:
        raise _too_large(str(reason)) from None
    body = body_of(arrays)
    data = seal(body, node_of(artifact.skill).kind, content_digest(arrays)) + body
    if len(data) > MAX_FILE_BYTES:
        raise _too_large(f"{len(data) >> 20} MiB")
    return data


def body_of(arrays: Mapping[str, Array], version: int = FORMAT_VERSION) -> bytes:
    """Return the file that holds ``arrays``, by path, without its seal."""
    file = BytesIO()
    # "earliest" is what every HDF5 tool in use reads; objects in one order, without times, give one result.
    with h5py.File(file, "w", userblock_size=SEAL_BYTES, libver="earliest") as body:
        body.attrs.create("format", np.bytes_(mark_of(version)))
        for path in sorted(arrays):
            body.create_dataset(path, data=arrays[path].astype(ARRAYS[path].dtype), track_times=False)
    return file.getvalue()[SEAL_BYTES:]


def require_room_for_records(
    demonstrations: DemonstrationSet, operation: Operation, provenance: Provenance
) -> None:
    """Raise now what ``encode`` would raise after a skill was learned from these demonstrations.

    The numbers of digits of its errors are not known yet. They are assumed to be small, so that nothing that
    fits is refused; ``encode`` refuses what little is left.

    Args:
        demonstrations: Those that the artifact will keep.
        operation: The record of the command.
        provenance: The record of its inputs.

    Raises:
        StoreError: The records of so many demonstrations do not fit into an artifact.
    """
    reports = [
        dumped_report(
            DemonstrationReport(
                source=demonstration.source,
                leaf=0,
                n_points=len(demonstration.times),
                duration=demonstration.duration,
                velocity_rmse=_FEW_DIGITS,
                dtw=_FEW_DIGITS,
                end_error=_FEW_DIGITS,
                arrived=True,
                moved=_FEW_DIGITS,
                dtw_unmoved=_FEW_DIGITS,
            )
        )
        for demonstration in demonstrations
    ]
    records = {
        "demonstrations": [label(demonstration.source) for demonstration in demonstrations],
        "operation": operation.model_dump(mode="json"),
        "provenance": provenance.model_dump(mode="json"),
        "reports": reports,
    }
    _require_metadata_fits(len(dump_canonical(records)), len(demonstrations))


def _require_metadata_fits(size: int, demonstrations: int) -> None:
    if size > MAX_LENGTHS["B"]:
        raise _too_large(
            f"the records about it, of {demonstrations} demonstrations among others, take {size} bytes, and "
            f"{MAX_LENGTHS['B']} fit",
            hint="Learn from fewer, as with --demos 0-99; some 170 files fit, and more in files of several.",
        )


def _too_large(what: str, hint: str = TOO_LARGE) -> StoreError:
    return StoreError(f"this skill is too large for an artifact: {what}.", hint=hint)
