"""The JSON documents that commands print, and their JSON Schemas, read off the types of the reports.

What `render.plain` does to a value is said here of its type: a float may be null, an array is a list of
lists. Whatever comes out of an artifact's metadata is described by pydantic.
"""

from __future__ import annotations

import json
import re
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

from skillctl.cli.render import SCHEMA_VERSION
from skillctl.errors import NotFoundError, SkillctlError

Schema: TypeAlias = dict[str, Any]

# What is printed with --json: module and class of the report. A command with several forms has them all.
OUTPUTS: dict[str, tuple[str, ...]] = {
    "learn": ("skillctl.usecases.learn:LearnReport", "skillctl.usecases.learn_many:LearnManyReport"),
    "merge": ("skillctl.usecases.merge:MergeReport",),
    "combine": ("skillctl.usecases.combine:CombineReport",),
    "inspect": ("skillctl.usecases.inspect:InspectReport", "skillctl.usecases.history:LineageReport"),
    "verify-stability": ("skillctl.usecases.verify_stability:VerifyReport",),
    "simulate": (
        "skillctl.usecases.simulate:SimulateReport",
        "skillctl.usecases.simulate_many:SimulateManyReport",
        "skillctl.usecases.check_reach:CheckReachReport",
    ),
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
    "schema": ("skillctl.usecases.schema:SchemaReport",),
    "completion": ("skillctl.cli.completion:CompletionReport",),
    "error": ("skillctl.cli.errors:Failure",),  # on standard error, whatever the command
}


def schema_of_output(name: str) -> Schema:
    """Return the JSON Schema (draft 2020-12) of what a command prints with ``--json``.

    Keys are only ever added under one ``schema_version``, so the schema allows others.

    Raises:
        NotFoundError: No command prints that.
    """
    from skillctl.cli.errors import nearest_word

    if name not in OUTPUTS:
        raise NotFoundError(
            f"no command prints {name!r}.", hint=nearest_word(name, OUTPUTS) or f"It is {', '.join(OUTPUTS)}."
        )
    catalogue = Catalogue()
    documents = [catalogue.schema_of(report) for report in report_types(name)]
    where = "standard error" if name == "error" else "standard output"
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{'an error' if name == 'error' else f'skillctl {name}'} with --json, on {where}",
        "type": "object",
        "properties": {"schema_version": {"const": SCHEMA_VERSION}},
        "required": ["schema_version"],
        **(documents[0] if len(documents) == 1 else {"anyOf": documents}),
        "$defs": catalogue.definitions,
    }


def report_types(name: str) -> list[type]:
    """Return the classes of the reports that are printed under a name."""
    places = (place.split(":") for place in OUTPUTS[name])
    return [getattr(import_module(module), kind) for module, kind in places]


class Catalogue:
    """Schemas of the types that documents are made of, each defined once.

    Attributes:
        definitions: By the name of the class.
    """

    def __init__(self) -> None:
        self.definitions: dict[str, Schema] = {}

    def schema_of(self, hint: Any) -> Schema:
        """Return the schema of what `render.plain` makes of a value of this type."""
        if get_origin(hint) is Annotated:
            return self.schema_of(get_args(hint)[0])
        if hint in SCALARS:
            return dict(SCALARS[hint])
        origin, arguments = get_origin(hint) or hint, get_args(hint)
        if origin in GENERICS:
            return GENERICS[origin](self, arguments)
        if "numpy." in repr(hint):  # NDArray[…] is of another class from NumPy to NumPy
            return {"$ref": f"#/$defs/{self._array(hint)}"}
        if isinstance(origin, type):
            return self._class(origin)
        raise TypeError(f"no JSON is known for {hint!r}")

    def _class(self, kind: type) -> Schema:
        if issubclass(kind, SkillctlError):
            from skillctl.cli.errors import Failure

            return self._class(Failure)
        if issubclass(kind, Path):
            return {"type": "string"}
        if issubclass(kind, Enum):
            return {"enum": [member.value for member in kind]}
        if kind.__name__ not in self.definitions:
            self.definitions[kind.__name__] = {}  # a tree refers to itself while it is described
            if is_dataclass(kind):
                self.definitions[kind.__name__] = self._object(kind)
            elif hasattr(kind, "model_json_schema"):
                self.definitions[kind.__name__] = self._metadata(kind)
            else:
                raise TypeError(f"no JSON is known for {kind!r}")
        return {"$ref": f"#/$defs/{kind.__name__}"}

    def _object(self, kind: Any) -> Schema:
        hints, said = get_type_hints(kind, include_extras=True), described_attributes(kind.__doc__ or "")
        properties = {}
        for field in fields(kind):
            schema = self.schema_of(hints[field.name])
            properties[field.name] = (
                {**schema, "description": said[field.name]} if field.name in said else schema
            )
        return {
            "type": "object",
            "description": cleandoc(kind.__doc__ or "").partition("\n\n")[0],
            "properties": properties,
            "required": list(properties),
        }

    def _metadata(self, kind: Any) -> Schema:
        """Return what pydantic says of a part of an artifact's metadata."""
        generated = kind.model_json_schema(mode="serialization")
        # The end of a text is a backslash and z to pydantic, but "$" in the expressions of JSON Schema.
        text = json.dumps(generated).replace("\\\\z", "$")
        schema: Schema = json.loads(text, object_hook=_opened)
        self.definitions.update(schema.pop("$defs", {}))
        return schema

    def _array(self, hint: Any) -> str:
        kind = "booleans" if "bool" in str(hint) else "numbers"
        entry = {"type": "boolean"} if kind == "booleans" else {"type": ["number", "null"]}
        nested = {"type": "array", "items": {"anyOf": [entry, {"$ref": f"#/$defs/{kind}"}]}}
        self.definitions[kind] = {**nested, "description": f"An array of {kind}: a list for each axis."}
        return kind


def described_attributes(docstring: str) -> dict[str, str]:
    """Return what the ``Attributes`` section of a docstring says of each name.

    One entry may describe several names: ``skill, path, digest: How to name it, where it is, what it is.``
    """
    _, _, section = cleandoc(docstring).partition("Attributes:\n")
    entries = re.split(r"\n(?= {4}\w)", f"\n{section.partition(chr(10) * 2)[0]}")
    described = {}
    for entry in filter(str.strip, entries):
        names, _, text = entry.strip().partition(": ")
        for name in names.split(", "):
            described[name] = " ".join(text.replace("``", "`").split())
    return described


def _opened(schema: Schema) -> Schema:
    """Return a schema that forbids no further keys."""
    return {key: value for key, value in schema.items() if (key, value) != ("additionalProperties", False)}


def _union(catalogue: Catalogue, members: Sequence[Any]) -> Schema:
    schemas = [catalogue.schema_of(member) for member in members]
    if all(schema.keys() == {"type"} for schema in schemas):
        named = [schema["type"] for schema in schemas]
        return {"type": list(dict.fromkeys(kind for kinds in named for kind in _listed(kinds)))}
    return {"anyOf": schemas}


def _listed(kinds: str | list[str]) -> list[str]:
    return [kinds] if isinstance(kinds, str) else kinds


def _tuple(catalogue: Catalogue, members: Sequence[Any]) -> Schema:
    if len(members) == 2 and members[1] is Ellipsis:
        return _list(catalogue, members[:1])
    entries = [catalogue.schema_of(member) for member in members]
    return {"type": "array", "prefixItems": entries, "minItems": len(entries), "maxItems": len(entries)}


def _list(catalogue: Catalogue, members: Sequence[Any]) -> Schema:
    return {"type": "array", "items": catalogue.schema_of(members[0])}


def _mapping(catalogue: Catalogue, members: Sequence[Any]) -> Schema:
    return {"type": "object", "additionalProperties": catalogue.schema_of(members[1])}


SCALARS: Mapping[Any, Schema] = {
    Any: {},
    None: {"type": "null"},
    type(None): {"type": "null"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": ["number", "null"]},  # NaN and infinity
    str: {"type": "string"},
}
GENERICS: Mapping[Any, Callable[[Catalogue, Sequence[Any]], Schema]] = {
    Literal: lambda _, values: {"enum": list(values)},
    Union: _union,
    types.UnionType: _union,
    tuple: _tuple,
    list: _list,
    Sequence: _list,
    dict: _mapping,
    Mapping: _mapping,
}
