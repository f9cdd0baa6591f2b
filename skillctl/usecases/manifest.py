"""Manifests of ``learn --batch``: many skills in one TOML file, each with its files and options.

    [options]                      # for all skills that do not say otherwise
    preset = "fast"

    [[skills]]
    name = "reach"                 # or output = "build/reach.h5"
    data = ["reach/*.csv"]         # files and patterns, relative to the manifest

    [[skills]]
    name = "lift"
    data = "low_dim.hdf5"
    demos = "0-19"
    seed = 3

The other keys are the options of ``skillctl learn`` by their long names, without the dashes in front.
"""

from __future__ import annotations

import glob
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Optional, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from skillctl.demonstrations.options import Reading
from skillctl.errors import InputDataError, NotFoundError, UsageError, did_you_mean, printable
from skillctl.learning.options import LearnOptions
from skillctl.options import Declared, options_of
from skillctl.toml_files import complaint, read_toml
from skillctl.usecases.destination import Destination
from skillctl.usecases.learn import LearnRequest
from skillctl.usecases.options import Result, Validation

HINT = "`skillctl learn --help` says what each option means; skillctl/docs/pipelines.md shows a manifest."
ROOMS = (Reading, LearnOptions, Validation)  # may be chosen for all skills, and for each
OF_EACH = frozenset(each.key for each in options_of(Result))


def _as_list(value: Any) -> Any:
    """Let one text stand for a list: ``"a.csv"``."""
    return [value] if isinstance(value, str) else value


Text = Annotated[str, Field(strict=True, min_length=1)]
Data = Annotated[tuple[Text, ...], BeforeValidator(_as_list), Field(min_length=1)]
STRICT: dict[Any, Any] = {
    str: Text,
    Path: Text,
    float: Annotated[float, Field(strict=True, allow_inf_nan=False)],
    int: Annotated[int, Field(strict=True)],
    bool: Annotated[bool, Field(strict=True)],
}


def _table(name: str, kinds: tuple[Any, ...], **more: Any) -> type[BaseModel]:
    """Return what checks the keys of a table: the options of these dataclasses, each by its long name."""
    fields: dict[str, Any] = {
        f"{each.field}_": (
            _checked(each),
            Field(each.default, alias=each.key),
        )  # some are names of pydantic's
        for kind in kinds
        for each in options_of(kind)
    }
    return create_model(name, __config__=ConfigDict(extra="forbid"), **fields, **more)


def _checked(declared: Declared) -> Any:
    """Return the type of a value as TOML has it; a text may stand for a list, as on the command line."""
    kind = Optional[Literal[declared.choices]] if declared.choices else _strict(declared.kind)  # noqa: UP045
    read = declared.option.read
    if read is None:
        return kind
    return Annotated[kind, BeforeValidator(lambda value: read(value) if isinstance(value, str) else value)]


def _strict(kind: Any) -> Any:
    """Return a type that takes no text for a number, and nothing else for what it is not."""
    if get_origin(kind) is tuple:
        return tuple.__class_getitem__((_strict(get_args(kind)[0]), ...))
    if get_origin(kind) in (Union, UnionType):
        return Union.__getitem__(tuple(map(_strict, get_args(kind))))
    return STRICT.get(kind, kind)


Choices = _table("Choices", ROOMS)
Skill = _table("Skill", (Result, *ROOMS), data=(Data, ...))


@dataclass(frozen=True)
class SkillEntry:
    """One skill of a manifest.

    Attributes:
        data: Files and patterns.
        result: Where the skill goes, and what is written with it; paths as the manifest has them.
        reading: How the files are read.
        learning: How it is learned.
        validation: Whether it is also judged by what it was not shown.
    """

    data: tuple[str, ...]
    result: Result
    reading: Reading
    learning: LearnOptions
    validation: Validation

    @property
    def called(self) -> str:
        """How the skill is told from others in reports."""
        return self.result.name or str(self.result.output or "")


@dataclass(frozen=True)
class Manifest:
    """Skills to be learned, and the file that says so."""

    path: Path
    skills: tuple[SkillEntry, ...]

    def request(self, entry: SkillEntry, store: Path | None, force: bool) -> LearnRequest:
        """Return what one skill asks for.

        Raises:
            NotFoundError: A pattern that no file matches.
            UsageError: No skill can be called so.
        """
        folder = self.path.parent
        result = entry.result
        output = None if result.output is None else folder / result.output
        return LearnRequest(
            paths=tuple(path for pattern in entry.data for path in self._files(pattern)),
            destination=Destination.at(output, result.name, store, result.message),
            options=entry.learning,
            reading=entry.reading,
            validated=entry.validation.validate,
            force=force,
            plot=None if result.plot is None else folder / result.plot,
        )

    def _files(self, pattern: str) -> list[Path]:
        """Return the files that a path or a pattern names, in the order of their names."""
        folder = self.path.parent
        if (folder / pattern).exists():
            return [folder / pattern]
        found = sorted(glob.glob(pattern, root_dir=folder, recursive=True))  # noqa: PTH207  # absolute ones, too
        if not found:
            raise NotFoundError(
                printable(f"{self.path}: data: no file matches {pattern!r}."),
                hint="Files and patterns are relative to the directory of the manifest.",
            )
        return [folder / name for name in found]


def read_manifest(path: Path) -> Manifest:
    """Return a manifest; all that can be known to be wrong without reading any data is found now.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is not TOML, or a key is unknown, missing or means nothing; names file, skill and
            key, and says what was expected.
    """
    document = read_toml(path, "manifest", HINT)
    try:
        entries = _entries(document)
    except ValueError as error:
        raise InputDataError(printable(f"{path}: {error}"), hint=HINT) from None
    _require_own_places(path, entries)
    return Manifest(path=path, skills=entries)


def _entries(document: dict[str, Any]) -> tuple[SkillEntry, ...]:
    """Return the skills of a manifest, or raise ValueError."""
    common, tables = document.pop("options", {}), document.pop("skills", None)
    for key in document:
        raise ValueError(f"{key}: there is no such key. {did_you_mean(key, ('options', 'skills'))}".rstrip())
    if not isinstance(common, dict):
        raise ValueError(f"options: must be a table [options], got {common!r}.")
    for key in common:
        if key in OF_EACH:
            raise ValueError(f"options: {key}: stands in [[skills]], for each by itself.")
    _checked_by(Choices, common, "options: ")
    if tables is None:
        raise ValueError("skills: is missing.")
    if not isinstance(tables, list) or not tables:
        raise ValueError(f"skills: must be a list of tables [[skills]], got {tables!r}.")
    return tuple(_entry(table, common, f"skill {number}: ") for number, table in enumerate(tables, start=1))


def _entry(table: Any, common: dict[str, Any], where: str) -> SkillEntry:
    if not isinstance(table, dict):
        raise ValueError(f"{where}must be a table [[skills]], got {table!r}.")
    values = _checked_by(Skill, {**common, **table}, where)
    if (values["name"] is None) == (values["output"] is None):
        raise ValueError(f"{where}must have a name for the store, or an output file, and not both.")

    def made(kind: Any) -> Any:
        return kind(**{each.field: values[each.key] for each in options_of(kind)})

    try:
        return SkillEntry(values["data"], made(Result), made(Reading), made(LearnOptions), made(Validation))
    except UsageError as error:
        raise ValueError(f"{where}{error}") from None


def _checked_by(kind: type[BaseModel], table: dict[str, Any], where: str) -> dict[str, Any]:
    """Return the values of a table by their keys, defaults among them; or raise ValueError."""
    try:
        return kind.model_validate(table).model_dump(by_alias=True)
    except ValidationError as error:
        keys = {field.alias or name for name, field in kind.model_fields.items()}
        raise ValueError(f"{where}{complaint(error.errors(include_url=False), keys)}") from None


def _require_own_places(path: Path, entries: tuple[SkillEntry, ...]) -> None:
    for key in ("name", "output", "plot"):
        given = (value for each in entries if (value := getattr(each.result, key)) is not None)
        places = Counter(map(os.path.normpath, given))
        for place, count in places.items():
            if count > 1:
                raise InputDataError(
                    printable(f"{path}: {key}: {place!r} is given to {count} skills; each needs its own."),
                    hint="Put all data of one skill in one list.",
                )
