"""The scenario that a file and single values come to, and its text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scenario_file import overridden, read_scenario, to_toml


def scenario_of(file: Path | None, given: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a TOML file, or the default one, with values given on top (see ``overridden``).

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It holds no scenario.
        UsageError: What was given on top means nothing.
    """
    return overridden(Scenario() if file is None else read_scenario(file), given)


def scenario_text(scenario: Scenario) -> str:
    """Return a scenario as a TOML file that reads back as an equal one."""
    return to_toml(scenario)
