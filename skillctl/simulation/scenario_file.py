"""Scenarios as TOML: read from a file, changed by options, and written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, UsageError
from skillctl.simulation.scenario import MeshObstacle, Obstacle, Scenario
from skillctl.toml_files import read_toml

HEADING = "# What `skillctl simulate` runs. Lengths are in metres, times in seconds, angles in radians.\n"
BARE = re.compile(r"[A-Za-z0-9_-]+")  # keys that TOML needs no quotes for
HINT = "`skillctl simulate --print-scenario` writes one with every key."


def read_scenario(path: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is not TOML, or a key is unknown, missing or has a bad value; names file and key.
    """
    document = read_toml(path, "scenario", HINT)
    if "package" in document:  # nobody's file decides which others are read
        raise InputDataError(f"{path}: package: this is for the command line.", hint="Add --package DIR.")
    try:
        scenario = Scenario(**document)
        obstacles = [_anchored(obstacle, path.parent) for obstacle in scenario.obstacles]
        return scenario.changed(obstacles=obstacles) if obstacles else scenario
    except UsageError as error:
        raise InputDataError(f"{path}: {error}", hint=error.hint or HINT) from None


def _anchored(obstacle: Obstacle, folder: Path) -> Obstacle:
    """Return an obstacle whose mesh is named from anywhere, not only from the folder of the scenario."""
    if not isinstance(obstacle, MeshObstacle) or "://" in obstacle.file:
        return obstacle
    return obstacle.model_copy(update={"file": str(folder.resolve() / obstacle.file)})


def overridden(scenario: Scenario, given: Mapping[str, Any]) -> Scenario:
    """Return a scenario changed by single values.

    Args:
        scenario: The scenario to change.
        given: Fields of ``Scenario`` and their values. A ``scene`` is given by its kind, or ``none``, and
            keeps its measures if it is of that kind already; ``cup``, ``place`` and ``bind`` keep what is not
            given; ``disturbances`` are added to those of the scenario.

    Raises:
        UsageError: The result is not a valid scenario.
    """
    changes = dict(given)
    kind = changes.pop("scene", None)
    if kind == "none":
        changes = {"scene": None, "cup": None, "place": None, **changes}
        if scenario.target == "cup":
            changes = {"target": None, **changes}
    elif kind is not None and (scenario.scene is None or scenario.scene.kind != kind):
        changes["scene"] = {"kind": kind}
    for name in ("cup", "place"):
        if changes.get(name) is not None:
            before = getattr(scenario, name)
            changes[name] = {**({} if before is None else before.model_dump()), **changes[name]}
    if "bind" in changes:
        changes["bind"] = {**scenario.bind, **changes["bind"]}
    changes["disturbances"] = (*scenario.disturbances, *changes.get("disturbances", ()))
    return scenario.changed(**changes)


def to_toml(scenario: Scenario) -> str:
    """Return a scenario as TOML with every key that has a value; reading it gives an equal scenario."""
    values = scenario.model_dump(exclude_none=True)
    tables = [(f"[{key}]", values.pop(key)) for key in list(values) if isinstance(values[key], dict)]
    for key in ("obstacles", "disturbances"):
        entries: Sequence[Mapping[str, Any]] = values.pop(key)
        tables += [(f"[[{key}]]", entry) for entry in entries]
    parts = [f"{HEADING}{_lines(values)}"]
    parts += [f"{heading}\n{_lines(table)}" for heading, table in tables if table]
    return "\n".join(parts)


def _lines(values: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in values.items())


def _key(key: str) -> str:
    return key if BARE.fullmatch(key) else _value(key)


def _value(value: Any) -> str:
    # JSON writes texts, finite numbers, booleans and lists as TOML does, except for DEL, which TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
