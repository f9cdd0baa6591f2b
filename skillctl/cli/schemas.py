"""JSON Schemas of reports: pydantic's, of what `render.plain` makes of a value.

A float may be null, an array is a list of lists, an error is a `Failure`, and keys may be added.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from inspect import cleandoc
from typing import Any, TypeAlias, get_type_hints

from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from skillctl.cli.errors import Failure
from skillctl.errors import SkillctlError

Schema: TypeAlias = dict[str, Any]
NUMBER: Schema = {"type": ["number", "null"]}
MOST_AXES = 3  # of an array in a report: one matrix a component


def schemas_of(reports: Sequence[type]) -> tuple[list[Schema], Schema]:
    """Return the schemas of reports, and the definitions that these refer to.

    Raises:
        TypeError: A type that has no form in JSON.
    """
    found = _adapter(reports).json_schema(mode="serialization", schema_generator=Plain)
    return found["prefixItems"], found.get("$defs", {})


def _adapter(kinds: Sequence[Any]) -> TypeAdapter[Any]:
    together: Any = tuple.__class_getitem__(tuple(kinds))
    return TypeAdapter(together, config=ConfigDict(arbitrary_types_allowed=True))


def _array(axes: int) -> Schema:
    """Return the schema of an array: a list for each axis."""
    entry: Schema = {"type": ["number", "boolean", "null"]}
    return {"type": "array", "items": {"anyOf": [entry, _array(axes - 1)]} if axes > 1 else entry}


def _opened(schema: Schema) -> Schema:
    """Return a schema that forbids no further keys."""
    return {key: value for key, value in schema.items() if key != "additionalProperties"}


def _summary(kind: type) -> str:
    return cleandoc(kind.__doc__ or "").partition("\n\n")[0]


def described_attributes(docstring: str) -> dict[str, str]:
    """Return what the ``Attributes`` section of a docstring says about each name.

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


class Plain(GenerateJsonSchema):
    """Writes the JSON Schemas of reports where they differ from pydantic's."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Leave the titles out: they would repeat the keys."""
        return False

    def float_schema(self, schema: Any) -> Schema:
        """Return the schema of a number: NaN and infinity become null."""
        return dict(NUMBER)

    def nullable_schema(self, schema: Any) -> Schema:
        """Return the schema of what may be null, which a number may be anyhow."""
        found = super().nullable_schema(schema)
        return dict(NUMBER) if found.get("anyOf") == [NUMBER, {"type": "null"}] else found

    def str_schema(self, schema: Any) -> Schema:
        """Return the schema of a text, the end of which is written $ in expressions of JSON Schema."""
        found = super().str_schema(schema)
        return {**found, "pattern": found["pattern"].replace(r"\z", "$")} if "pattern" in found else found

    def is_instance_schema(self, schema: Any) -> Schema:
        """Return the schema of what pydantic does not know."""
        kind = schema["cls"]
        if issubclass(kind, SkillctlError):
            return self._of(Failure)
        if kind.__name__ == "ndarray":
            return _array(MOST_AXES)
        raise TypeError(f"no JSON is known for {kind!r}")

    def model_schema(self, schema: Any) -> Schema:
        """Return the schema of a part of an artifact's metadata."""
        return _opened(super().model_schema(schema))

    def dataclass_schema(self, schema: Any) -> Schema:
        """Return the schema of a report: all keys are there, and its docstring says what they mean."""
        found, kind = super().dataclass_schema(schema), schema["cls"]
        said = {}
        for each in reversed(kind.__mro__):  # a base describes its own fields
            said.update(described_attributes(each.__doc__ or ""))
        properties = found["properties"]
        for field in fields(kind):
            if field.name not in properties:  # pydantic passes over what is computed at the start
                properties[field.name] = self._of(get_type_hints(kind)[field.name])
            properties[field.name].pop("default", None)
            if field.name in said:
                properties[field.name]["description"] = said[field.name]
        return {**_opened(found), "description": _summary(kind), "required": list(properties)}

    def enum_schema(self, schema: Any) -> Schema:
        """Return the schema of an enumeration."""
        return {**super().enum_schema(schema), "description": _summary(schema["cls"])}

    def _of(self, kind: Any) -> Schema:
        found: Schema = self.generate_inner(_adapter([kind]).core_schema)["prefixItems"][0]
        return found
