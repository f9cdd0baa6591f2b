"""FORMAT.md is normative, so it must say what the code does."""

import re
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from skillctl.errors import ArtifactError
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES
from skillctl.store import (
    canonical,
    errors,
    files,
    folder,
    layout,
    local,
    locating,
    migrations,
    references,
    schema,
    seal,
    ties,
    tree,
)

PAGE = (Path(schema.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", layout.ARRAYS)
def test_every_array_stands_in_the_table(path):
    spec = layout.ARRAYS[path]
    shape = ", ".join(spec.lengths) + ("," if len(spec.lengths) == 1 else "")
    assert f"| `/{path}` | {spec.dtype[1:]} | ({shape}) |" in PAGE


@pytest.mark.parametrize("length", [name for name in layout.MAX_LENGTHS if name != "D+1"])
def test_every_limit_stands_in_the_table(length):
    assert f"| {length} | 1 | {layout.MAX_LENGTHS[length]} |" in PAGE


MODELS = [
    value for module in (schema, ties) for value in vars(module).values()
    if isinstance(value, type(BaseModel)) and value.__module__ == module.__name__
]  # fmt: skip


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_key_of_the_metadata_is_described(model):
    section = PAGE[PAGE.index("## 3.") : PAGE.index("## 4.")]
    for name in model.model_fields:
        assert f"`{name}`" in section, name


def test_every_gate_and_its_parameters_are_described():
    for gate in (*MERGE_GATES, *COMBINE_GATES):
        assert f'`"{gate.name}"`' in PAGE
    for parameter in (parameter for gate in MERGE_GATES for parameter in gate.parameters):
        assert f"`{parameter.name}` ≥ {parameter.least:g}" in PAGE


def test_every_command_is_described():
    for command in get_args(schema.Operation.model_fields["command"].annotation):
        assert f'`"{command}"`' in PAGE


def test_numbers_agree():
    assert f"at most {files.MAX_FILE_BYTES >> 20} MiB" in PAGE
    assert (
        f"at most {layout.MAX_ARRAY_BYTES >> 20} MiB, all together {layout.MAX_TOTAL_BYTES >> 20} MiB" in PAGE
    )
    assert f"up to offset {seal.SEAL_BYTES}" in PAGE
    assert "`" + " ".join(f"{byte:02X}" for byte in seal.MAGIC) + "`" in PAGE
    assert all(f"`{migrations.mark_of(version).decode()}`" in PAGE for version in migrations.READABLE_FORMATS)
    assert f"| `format` | {migrations.FORMAT_VERSION}; " in PAGE
    assert all(f"`{kind}`" in PAGE for kind in seal.KINDS)
    assert f"{canonical.MAX_DEPTH} deep" in PAGE
    assert f"at most {tree.MAX_TREE_DEPTH} nodes deep" in PAGE
    assert f"1 to {references.MAX_VERSION}" in PAGE
    assert re.search(rf"at most {schema.MAX_LABEL}\s+characters", PAGE)
    assert f"at most {schema.MAX_TEXT} characters" in PAGE
    assert PAGE.startswith(
        f"# The skill artifact, formats {' and '.join(map(str, migrations.READABLE_FORMATS))}"
    )


def test_the_store_is_described_as_it_is():
    section = PAGE[PAGE.index("## 6.") : PAGE.index("## 7.")]
    assert f"`{local.TEMPORARY_PREFIX}`" in section
    assert f"`.{folder.REFS_FILE}.`" in section
    assert f"mode 0{locating.FILE_MODE:o}" in section
    assert files.STALE_SECONDS == 3600
    assert "older than an hour" in section
    assert f"`<version>.h5{folder.SIGNATURE_SUFFIX}`" in section
    for pattern in (references._NAME, references._WORD):
        assert f"`{pattern.pattern}`" in section


def test_every_error_is_explained():
    for name, value in vars(errors).items():
        if (
            isinstance(value, type)
            and issubclass(value, ArtifactError)
            and value.__module__ == errors.__name__
        ):
            assert f"`{name}`" in PAGE or name in {"UnsupportedFormatError", "RefusedFileError"}
