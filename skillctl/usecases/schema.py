"""The JSON Schema of an artifact's metadata."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from skillctl.store import metadata_schema
from skillctl.store.migrations import FORMAT_VERSION


@dataclass(frozen=True)
class SchemaReport:
    """A JSON Schema.

    Attributes:
        schema: The schema, draft 2020-12.
        format: Version of the artifact format, if that is what it describes.
    """

    schema: dict[str, Any]
    format: int | None = None


def schema_of_metadata() -> SchemaReport:
    """Return the JSON Schema of meta.json in the artifacts that this build writes.

    It says which keys and types there are; FORMAT.md says what must hold between them.
    """
    return SchemaReport(metadata_schema(), FORMAT_VERSION)
