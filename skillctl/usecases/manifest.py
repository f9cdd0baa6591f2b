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
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from skillctl.demonstrations.options import Reading
from skillctl.errors import InputDataError, NotFoundError, UsageError, did_you_mean, printable
from skillctl.learning.options import LearnOptions, Metric, Objective, Preset
from skillctl.toml_files import read_toml
from skillctl.usecases.destination import Destination
from skillctl.usecases.learn import LearnRequest
from skillctl.usecases.ranges import read_ranges

HINT = "`skillctl learn --help` says what each option means; skillctl/docs/pipelines.md shows a manifest."
# What pydantic says in a programmer's words, and how it is said here; in this order.
REWORDED = {
    "Input should be": "must be",
    "Tuple should": "must",
    "Value should": "must",
    "String should": "must",
    " after validation": "",
    "a valid tuple": "a list",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid string": "a text",
    "a valid boolean": "true or false",
    "a valid dictionary or instance of SkillEntry": "a table [[skills]]",
    "a valid dictionary or instance of Choices": "a table [options]",
}


def _as_list(value: Any) -> Any:
    """Let one text stand for a list: ``"a.csv"``."""
    return [value] if isinstance(value, str) else value


def _as_words(value: Any) -> Any:
    """Let a text stand for a list as on the command line: ``"x,y,z"``."""
    return [word.strip() for word in value.split(",")] if isinstance(value, str) else value


def _as_indices(value: Any) -> Any:
    """Let a text stand for a list as on the command line: ``"0,2,5-9"``."""
    return read_ranges(value) if isinstance(value, str) else value


def _as_components(value: Any) -> Any:
    if value == "auto" or type(value) is int:
        return value
    raise ValueError(f"must be a whole number or 'auto', got {printable(repr(value))[:80]}.")


Text = Annotated[str, Field(strict=True, min_length=1)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Index = Annotated[int, Field(strict=True, ge=0)]


class Choices(BaseModel):
    """What may be chosen for all skills of a manifest, and for each; nothing that is left out."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, alias_generator=lambda name: name.replace("_", "-")
    )

    input_format: Literal["csv", "tum", "npz", "robomimic", "lasa", "lpvds"] | None = None
    columns: Annotated[tuple[Text, ...], BeforeValidator(_as_words)] | None = None
    dt: Number | None = None
    units: Literal["m", "mm", "rad"] | None = None
    scale: Number = 1.0
    demos: Annotated[tuple[Index, ...], BeforeValidator(_as_indices)] | None = None
    frame: Text = "base"
    objective: Objective = "reproduction"
    metric: Metric = "learned"
    components: Annotated[int | Literal["auto"], BeforeValidator(_as_components)] | None = None
    preset: Preset = "default"
    seed: Annotated[int, Field(strict=True)] = 0
    slowest_rate: Number = 0.03
    period: Number = 0.01
    validate_: Annotated[bool, Field(strict=True, alias="validate")] = False

    @property
    def reading(self) -> Reading:
        """How the files are read."""
        return Reading(
            self.input_format, self.columns, self.dt, self.units, self.scale, self.demos, self.frame
        )

    @property
    def learning(self) -> LearnOptions:
        """How it is learned.

        Raises:
            UsageError: A value outside its range.
        """
        return LearnOptions(
            self.objective,
            self.metric,
            self.components,
            self.preset,
            self.seed,
            self.slowest_rate,
            self.period,
        )


class SkillEntry(Choices):
    """One skill of a manifest."""

    data: Annotated[tuple[Text, ...], BeforeValidator(_as_list), Field(min_length=1)]
    name: Text | None = None
    output: Text | None = None
    message: Text | None = None
    plot: Text | None = None

    @model_validator(mode="after")
    def _makes_sense(self) -> SkillEntry:
        if (self.name is None) == (self.output is None):
            raise ValueError("must have a name for the store, or an output file, and not both.")
        try:
            _ = self.learning
        except UsageError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def called(self) -> str:
        """How the skill is told from others in reports."""
        return self.name or self.output or ""


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    skills: Annotated[tuple[SkillEntry, ...], Field(min_length=1)]


OF_EACH = frozenset(SkillEntry.model_fields) - frozenset(Choices.model_fields)


class Manifest(BaseModel):
    """Skills to be learned, and the file that says so."""

    model_config = ConfigDict(frozen=True)

    path: Path
    skills: tuple[SkillEntry, ...]

    def request(self, entry: SkillEntry, store: Path | None, force: bool) -> LearnRequest:
        """Return what one skill asks for.

        Raises:
            NotFoundError: A pattern that no file matches.
            UsageError: No skill can be called so.
        """
        folder = self.path.parent
        output = None if entry.output is None else folder / entry.output
        return LearnRequest(
            paths=tuple(path for pattern in entry.data for path in self._files(pattern)),
            destination=Destination.at(output, entry.name, store, entry.message),
            options=entry.learning,
            reading=entry.reading,
            validated=entry.validate_,
            force=force,
            plot=None if entry.plot is None else folder / entry.plot,
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
    common = document.pop("options", {})
    try:
        Choices.model_validate(common)
    except ValidationError as error:
        raise InputDataError(f"{path}: options: {_in_words(error, Choices)}", hint=HINT) from None
    skills = document.get("skills")
    if isinstance(skills, list):
        document["skills"] = [{**common, **each} if isinstance(each, dict) else each for each in skills]
    try:
        entries = _Document.model_validate(document).skills
    except ValidationError as error:
        raise InputDataError(f"{path}: {_in_words(error, SkillEntry)}", hint=HINT) from None
    _require_own_places(path, entries)
    return Manifest(path=path, skills=entries)


def _require_own_places(path: Path, entries: tuple[SkillEntry, ...]) -> None:
    for key in ("name", "output", "plot"):
        given = (value for each in entries if (value := getattr(each, key)) is not None)
        places = Counter(map(os.path.normpath, given))
        for place, count in places.items():
            if count > 1:
                raise InputDataError(
                    printable(f"{path}: {key}: {place!r} is given to {count} skills; each needs its own."),
                    hint="Put all data of one skill in one list.",
                )


def _in_words(error: ValidationError, kind: type[Choices]) -> str:
    """Return the first thing that is wrong: which skill, which key, what was expected, what it is."""
    first = error.errors(include_url=False)[0]
    steps = list(first["loc"])
    where = ""
    if steps[:1] == ["skills"] and len(steps) > 1:
        where = f"skill {int(steps[1]) + 1}: "  # counted as people count the tables
        del steps[:2]
    names = {field.alias or name for name, field in kind.model_fields.items()}
    key = str(steps[0]) if steps else ""
    number = f"number {int(steps[1]) + 1} " if len(steps) > 1 and isinstance(steps[1], int) else ""
    said = f"{where}{key}: {number}" if key else where
    match first["type"]:
        case "value_error":
            return printable(f"{said}{first['ctx']['error']}")
        case "missing":
            return printable(f"{said}is missing.")
        case "extra_forbidden":
            if kind is Choices and key in OF_EACH:
                return f"{said}stands in [[skills]], for each by itself."
            meant = did_you_mean(key.replace("_", "-"), sorted(names))
            return printable(f"{said}there is no such key. {meant}").rstrip()
    expected = first["msg"]
    for pydantic, ours in REWORDED.items():
        expected = expected.replace(pydantic, ours)
    given = "" if isinstance(first["input"], dict) else f", got {printable(repr(first['input']))[:80]}"
    return printable(f"{said}{expected}{given}.")
