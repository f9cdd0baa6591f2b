"""``skillctl schema``."""

from __future__ import annotations

import typer

from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl schema > meta.schema.json"""


def schema(context: typer.Context) -> None:
    """Print the JSON Schema of the metadata in a skill artifact."""
    from skillctl.usecases.schema import schema as schema_of

    output: Output = context.obj
    report = schema_of()
    if output.as_json:
        output.result(report, list)
    else:
        output.document(report.schema)
