"""Skills on disk: sealed artifacts, and a store of their versions.

Names are imported on first use, so that listing a store loads neither HDF5 nor pydantic.
"""
# mypy: implicit-reexport
# ruff: noqa: F401 - what follows is what this package offers

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skillctl.store.artifact import Artifact, contents_of, metadata_of
    from skillctl.store.files import write_changed, write_file
    from skillctl.store.locating import existing_store, locate_store, require_outside_store
    from skillctl.store.lockfile import (
        Lock,
        LockedSkill,
        is_lock,
        locate_again,
        locate_lock,
        lock_text,
        locked_skill,
        read_lock,
    )
    from skillctl.store.provenance import current_provenance, input_fingerprint, input_record
    from skillctl.store.reader import decode, digest_of, read_skill
    from skillctl.store.references import Reference, parse_reference
    from skillctl.store.registry import Located, Registry, StoredVersion, locate
    from skillctl.store.schema import (
        DemonstrationReport,
        InputRecord,
        Operation,
        ParentRecord,
        Provenance,
        metadata_schema,
    )
    from skillctl.store.seal import Header, read_header
    from skillctl.store.signing import (
        Signature,
        add_signature,
        make_signature,
        read_private_key,
        read_public_key,
        read_signatures,
        signature_state,
        signatures_path,
    )
    from skillctl.store.writer import encode, require_room_for_records


# The same names at run time; a test compares the two.
_HOMES = {
    name: module
    for module, names in {
        "artifact": "Artifact contents_of metadata_of",
        "files": "write_changed write_file",
        "lockfile": "Lock LockedSkill is_lock locate_again locate_lock lock_text locked_skill read_lock",
        "locating": "existing_store locate_store require_outside_store",
        "provenance": "current_provenance input_fingerprint input_record",
        "reader": "decode digest_of read_skill",
        "references": "Reference parse_reference",
        "registry": "Located Registry StoredVersion locate",
        "schema": "DemonstrationReport InputRecord Operation ParentRecord Provenance metadata_schema",
        "seal": "Header read_header",
        "signing": "Signature add_signature make_signature read_private_key read_public_key read_signatures "
        "signature_state signatures_path",
        "writer": "encode require_room_for_records",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
