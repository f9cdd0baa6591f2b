"""The JSON Schema of an artifact's metadata."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from skillctl.store import metadata_schema
from skillctl.store.seal import FORMAT_VERSION


@dataclass(frozen=True)
class SchemaReport:
    """The schema of meta.json.

    Attributes:
        format: Version of the artifact format.
        schema: JSON Schema, draft 2020-12.
    """

    format: int
    schema: dict[str, Any]


def schema() -> SchemaReport:
    """Return the JSON Schema of meta.json in the artifacts that this build writes.

    It says which keys and types there are; FORMAT.md says what must hold between them.
    """
    return SchemaReport(FORMAT_VERSION, metadata_schema())
