"""``skillctl schema``: the JSON documents that commands print, and their JSON Schemas."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any

import typer

from skillctl.cli.errors import nearest_word
from skillctl.cli.output import Output
from skillctl.cli.render import SCHEMA_VERSION
from skillctl.errors import NotFoundError

EXAMPLES = """\b
Example:
  skillctl schema > meta.schema.json
  skillctl schema learn > learn.schema.json
  skillctl schema error | jq .properties"""

# What is printed with --json: module and class of the report. A command with several forms has them all.
OUTPUTS: dict[str, tuple[str, ...]] = {
    "learn": ("skillctl.usecases.learn:LearnReport", "skillctl.usecases.learn_many:LearnManyReport"),
    "merge": ("skillctl.usecases.merge:MergeReport",),
    "combine": ("skillctl.usecases.combine:CombineReport", "skillctl.usecases.chain:ChainReport"),
    "chain": ("skillctl.usecases.chain:ChainReport",),
    "adapt": ("skillctl.usecases.adapt:AdaptReport",),
    "inspect": ("skillctl.usecases.inspect:InspectReport", "skillctl.usecases.history:LineageReport"),
    "verify-stability": ("skillctl.usecases.verify_stability:VerifyReport",),
    "simulate": (
        "skillctl.usecases.simulate:SimulateReport",
        "skillctl.usecases.simulate_many:SimulateManyReport",
        "skillctl.usecases.check_reach:CheckReachReport",
    ),
    "run": ("skillctl.usecases.run:RunReport",),
    "quickstart": ("skillctl.usecases.quickstart:QuickstartReport",),
    "ls": ("skillctl.usecases.ls:StoreReport",),
    "diff": ("skillctl.usecases.diff:DiffReport",),
    "log": ("skillctl.usecases.history:LogReport",),
    "tag": ("skillctl.usecases.versions:TagReport",),
    "untag": ("skillctl.usecases.versions:TagReport",),
    "lock": ("skillctl.usecases.lock:LockReport",),
    "sign": ("skillctl.usecases.sign:SignReport",),
    "verify-signature": ("skillctl.usecases.sign:SignatureReport",),
    "rm": ("skillctl.usecases.versions:RemoveReport",),
    "gc": ("skillctl.usecases.versions:RemoveReport",),
    "export": ("skillctl.usecases.export:ExportReport",),
    "schema": ("skillctl.cli.schema:SchemaReport",),
    "completion": ("skillctl.cli.completion:CompletionReport",),
    "error": ("skillctl.cli.errors:Failure",),  # on standard error, whatever the command
}


@dataclass(frozen=True)
class SchemaReport:
    """A JSON Schema.

    Attributes:
        schema: The schema, draft 2020-12.
        format: Version of the artifact format, if that is what it describes.
    """

    schema: dict[str, Any]
    format: int | None = None


def schema_of_output(name: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of what a command prints with ``--json``.

    Keys are only ever added under one ``schema_version``, so the schema allows others.

    Raises:
        NotFoundError: No command prints that.
    """
    if name not in OUTPUTS:
        hint = nearest_word(name, OUTPUTS) or f"It is {', '.join(OUTPUTS)}."
        raise NotFoundError(f"no command prints {name!r}.", hint=hint)
    from skillctl.cli.schemas import schemas_of

    documents, definitions = schemas_of(report_types(name))
    where = "standard error" if name == "error" else "standard output"
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{'an error' if name == 'error' else f'skillctl {name}'} with --json, on {where}",
        "type": "object",
        "properties": {"schema_version": {"const": SCHEMA_VERSION}},
        "required": ["schema_version"],
        **(documents[0] if len(documents) == 1 else {"anyOf": documents}),
        "$defs": definitions,
    }


def report_types(name: str) -> list[type]:
    """Return the classes of the reports that are printed under a name."""
    places = (place.split(":") for place in OUTPUTS[name])
    return [getattr(import_module(module), kind) for module, kind in places]


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
