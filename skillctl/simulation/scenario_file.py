"""Scenarios as TOML: read from a file, changed by what was typed, written so that they read back the same."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, UsageError
from skillctl.simulation.scenario import Scenario
from skillctl.toml_files import read_toml

HEADING = "# What `skillctl simulate` runs. Lengths are in metres, times in seconds, angles in radians.\n"
HINT = "`skillctl simulate --print-scenario` writes one with every key."


def read_scenario(path: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is not TOML, or a key is unknown, missing or means nothing; names file and key.
    """
    document = read_toml(path, "scenario", HINT)
    try:
        return Scenario(**document)
    except UsageError as error:
        raise InputDataError(f"{path}: {error}", hint=error.hint or HINT) from None


def overridden(scenario: Scenario, given: Mapping[str, Any]) -> Scenario:
    """Return a scenario changed by single values.

    Args:
        scenario: To begin with.
        given: Fields of ``Scenario`` and their values. A ``scene`` is given by its kind, or ``none``, and
            keeps its measures if it is of that kind already; of a ``cup`` only what is given changes;
            ``disturbances`` are added to those there.

    Raises:
        UsageError: The result means nothing.
    """
    changes = dict(given)
    kind = changes.pop("scene", None)
    if kind == "none":
        changes = {"scene": None, "cup": None, **changes}
        if scenario.target == "cup":
            changes = {"target": None, **changes}
    elif kind is not None and (scenario.scene is None or scenario.scene.kind != kind):
        changes["scene"] = {"kind": kind}
    if changes.get("cup") is not None:
        standing = {} if scenario.cup is None else scenario.cup.model_dump()
        changes["cup"] = {**standing, **changes["cup"]}
    changes["disturbances"] = (*scenario.disturbances, *changes.get("disturbances", ()))
    return scenario.changed(**changes)


def to_toml(scenario: Scenario) -> str:
    """Return a scenario as TOML with every key that has a value; it reads back as an equal scenario."""
    values = scenario.model_dump(exclude_none=True)
    disturbances: Sequence[Mapping[str, Any]] = values.pop("disturbances")
    tables = {key: value for key, value in values.items() if isinstance(value, dict)}
    parts = [HEADING, *(_line(key, value) for key, value in values.items() if key not in tables)]
    for key, table in tables.items():
        if table:
            parts += [f"\n[{key}]\n", *(_line(name, value) for name, value in table.items())]
    for event in disturbances:
        parts += ["\n[[disturbances]]\n", *(_line(name, value) for name, value in event.items())]
    return "".join(parts)


def _line(key: str, value: Any) -> str:
    return f"{key} = {_value(value)}\n"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's but for DEL, which TOML wants escaped, and surrogates, which it lacks.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)
