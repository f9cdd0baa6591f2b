"""``skillctl schema``."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl schema > meta.schema.json
  skillctl schema learn > learn.schema.json
  skillctl schema error | jq .properties"""


def schema(
    context: typer.Context,
    output_name: Annotated[
        str | None,
        typer.Argument(
            metavar="[OUTPUT]", help="A command, or error. Default: the metadata in a skill artifact."
        ),
    ] = None,
) -> None:
    """Print the JSON Schema of what a command prints with --json, or of the metadata in a skill artifact.

    Keys are only ever added to an output while its schema_version stays the same.
    """
    from skillctl.cli.documents import SchemaReport, schema_of_output
    from skillctl.store import metadata_schema
    from skillctl.store.migrations import FORMAT_VERSION

    output: Output = context.obj
    if output_name is None:
        report = SchemaReport(metadata_schema(), FORMAT_VERSION)
    else:
        report = SchemaReport(schema_of_output(output_name))
    if output.as_json:
        output.result(report, list)
    else:
        output.verbatim(f"{json.dumps(report.schema, indent=2)}\n")
