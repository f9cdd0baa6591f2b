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
from typing import Annotated, Any, Literal, Optional, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from skillctl.demonstrations.options import Reading
from skillctl.errors import InputDataError, NotFoundError, UsageError, did_you_mean, printable
from skillctl.learning.options import LearnOptions
from skillctl.options import Declared, options_of
from skillctl.toml_files import complaint, read_toml
from skillctl.usecases.destination import Destination
from skillctl.usecases.learn import LearnRequest
from skillctl.usecases.options import Result, Robot, Validation

HINT = "`skillctl learn --help` says what each option means; skillctl/docs/pipelines.md shows a manifest."
ROOMS: tuple[Any, ...] = (Reading, Robot, LearnOptions, Validation)  # may be chosen for all, and for each


def _table(name: str, kinds: tuple[Any, ...], **more: Any) -> type[BaseModel]:
    """Return what checks the keys of a table: the options of these dataclasses, each by its long name."""
    fields: dict[str, Any] = {  # underscores at the end, as some are names of pydantic's
        f"{each.field}_": (_checked(each), Field(each.default, alias=each.key))
        for kind in kinds
        for each in options_of(kind)
    }
    # Strict: 3 and true are no text, and "3" is no number.
    config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, str_min_length=1)
    return create_model(name, __config__=config, **fields, **more)


def _checked(declared: Declared) -> Any:
    """Return the type of a value as TOML has it; a text may stand for a list, as on the command line."""
    kind = Optional[Literal[declared.choices]] if declared.choices else declared.kind  # noqa: UP045
    if Path in get_args(kind):
        kind = Optional[str]  # noqa: UP045  # made a path with the directory of the manifest

    def read(value: Any) -> Any:
        if isinstance(value, str) and declared.option.read is not None:
            return declared.option.read(value)
        return tuple(value) if isinstance(value, list) else value

    return Annotated[kind, BeforeValidator(read)]


Data = Annotated[
    tuple[str, ...],
    Field(strict=False, min_length=1),  # TOML has lists
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
]
Choices = _table("Choices", ROOMS)
Skill = _table("Skill", (Result, *ROOMS), data=(Data, ...))


@dataclass(frozen=True)
class SkillEntry:
    """One skill of a manifest.

    Attributes:
        manifest: The file that lists it.
        data: Files and patterns.
        result: Where the skill goes, and what is written with it; paths as the manifest has them.
        reading: How the files are read.
        robot: The arm whose joints they hold, a file as the manifest has it.
        learning: How it is learned.
        validation: Whether it is also judged by demonstrations that it was not learned from.
    """

    manifest: Path
    data: tuple[str, ...]
    result: Result
    reading: Reading
    robot: Robot
    learning: LearnOptions
    validation: Validation

    @property
    def called(self) -> str:
        """How reports name the skill."""
        return self.result.name or str(self.result.output or "")

    def request(self, store: Path | None, force: bool) -> LearnRequest:
        """Return the request to learn the skill.

        Raises:
            NotFoundError: A pattern that no file matches.
            UsageError: No skill can be called so.
        """
        folder, result = self.manifest.parent, self.result
        output, plot = (None if path is None else folder / path for path in (result.output, result.plot))
        return LearnRequest(
            paths=tuple(path for pattern in self.data for path in self._files(pattern)),
            destination=Destination.at(output, result.name, store, result.message),
            options=self.learning,
            reading=self.reading,
            robot=self.robot.beside(folder),
            validated=self.validation.validate,
            force=force,
            plot=plot,
        )

    def _files(self, pattern: str) -> list[Path]:
        """Return the files that a path or a pattern names, in the order of their names."""
        folder = self.manifest.parent
        if (folder / pattern).exists():
            return [folder / pattern]
        found = sorted(glob.glob(pattern, root_dir=folder, recursive=True))  # noqa: PTH207  # absolute ones, too
        if not found:
            raise NotFoundError(
                printable(f"{self.manifest}: data: no file matches {pattern!r}."),
                hint="Files and patterns are relative to the directory of the manifest.",
            )
        return [folder / name for name in found]


def read_manifest(path: Path) -> tuple[SkillEntry, ...]:
    """Return the skills of a manifest; every mistake that can be found without reading data is found now.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is not TOML, or a key is unknown, missing or means nothing; names file, skill and
            key, and says what was expected.
    """
    document = read_toml(path, "manifest", HINT)
    try:
        common, tables = document.pop("options", {}), document.pop("skills", None)
        _require_tables(document, common, tables)
        entries = [_entry(path, table, common, number) for number, table in enumerate(tables, start=1)]
    except ValueError as error:
        raise InputDataError(printable(f"{path}: {error}"), hint=HINT) from None
    for key in ("name", "output", "plot"):
        given = [value for each in entries if (value := getattr(each.result, key)) is not None]
        for place, count in Counter(map(os.path.normpath, given)).items():
            if count > 1:
                raise InputDataError(
                    printable(f"{path}: {key}: {place!r} is given to {count} skills; each needs its own."),
                    hint="Put all data of one skill in one list.",
                )
    return tuple(entries)


def _require_tables(others: dict[str, Any], common: Any, tables: Any) -> None:
    """Raise ValueError unless a manifest has the tables that it should have, and no others."""
    for key in others:
        raise ValueError(f"{key}: there is no such key. {did_you_mean(key, ('options', 'skills'))}".rstrip())
    if not isinstance(common, dict):
        raise ValueError(f"options: must be a table [options], got {common!r}.")
    for each in options_of(Result):
        if each.key in common:
            raise ValueError(f"options: {each.key}: must be given in [[skills]], for each skill by itself.")
    _values(Choices, common, "options: ")
    if tables is None:
        raise ValueError("skills: is missing.")
    if not isinstance(tables, list) or not tables:
        raise ValueError(f"skills: must be a list of tables [[skills]], got {tables!r}.")


def _entry(manifest: Path, table: Any, common: dict[str, Any], number: int) -> SkillEntry:
    where = f"skill {number}: "
    if not isinstance(table, dict):
        raise ValueError(f"{where}must be a table [[skills]], got {table!r}.")
    values = _values(Skill, {**common, **table}, where)
    if (values["name"] is None) == (values["output"] is None):
        raise ValueError(f"{where}must have a name for the store, or an output file, and not both.")
    try:
        chosen = [
            kind(**{each.field: values[each.key] for each in options_of(kind)}) for kind in (Result, *ROOMS)
        ]
    except UsageError as error:
        raise ValueError(f"{where}{error}") from None
    return SkillEntry(manifest, values["data"], *chosen)


def _values(kind: type[BaseModel], table: dict[str, Any], where: str) -> dict[str, Any]:
    """Return the values of a table by their keys, defaults among them; or raise ValueError."""
    try:
        return kind.model_validate(table).model_dump(by_alias=True)
    except ValidationError as error:
        keys = {field.alias or name for name, field in kind.model_fields.items()}
        raise ValueError(f"{where}{complaint(error.errors(include_url=False), keys)}") from None
