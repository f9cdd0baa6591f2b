"""Scenarios with extreme numbers: python tests/torture/scenarios.py SKILL [--seconds 120] [--stride 1]

Every number of a scenario with a shelf, a cup, obstacles and every disturbance is replaced by extreme ones,
one at a time, and simulated in a process of its own. It has to end in time, as an episode or with an error in
words; the exit code is 1 if one did not.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from skillctl import store
from skillctl.errors import SkillctlError
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

EXTREMES = (1e-308, 1e-12, 1e-3, 1e2, 1e3, 1e5, 1e6, 1e308)
FULL: dict[str, Any] = {
    "start": (0.4, 0.0, 0.55), "target": "cup", "origin": (0.0, 0.0, 0.0), "scale": 1.0, "base_yaw": 0.0,
    "max_speed": 0.3, "max_acceleration": 1.5, "max_duration": 8.0, "tolerance": 2e-3, "settle_time": 0.5,
    "noise": 1e-4, "target_error": 1e-4,
    "scene": {
        "kind": "shelf", "boards": (0.42, 0.70), "x_range": (0.5, 0.8), "width": 1.2, "thickness": 0.02,
    },
    "cup": {"position": (0.62, 0.1), "radius": 0.032, "height": 0.12, "mass": 0.1, "friction": 0.5},
    "grasp": {
        "distance": 0.006, "force": 20.0, "speed": 0.1, "close_time": 0.8, "lift": 0.1, "lift_time": 1.2,
        "hold_time": 1.0, "rise": 0.05,
    },
    "obstacles": [
        {"kind": "box", "position": (0.2, 0.6, 0.2), "yaw": 0.0, "size": (0.1, 0.1, 0.1)},
        {"kind": "cylinder", "position": (0.2, -0.6, 0.2), "radius": 0.1, "height": 0.1, "mass": 1.0},
    ],
    "disturbances": [
        {"kind": "push", "time": 0.1, "duration": 0.1, "force": (1.0, 0.0, 0.0)},
        {"kind": "move-target", "time": 0.2, "offset": (0.0, 0.01, 0.0)},
        {"kind": "displace", "time": 0.3, "offset": (0.0, 0.01, 0.0), "turn": (0.0, 0.0, 0.0)},
    ],
}  # fmt: skip


def changed(value: Any, extremes: tuple[float, ...], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield where, and the value with one of its numbers replaced."""
    if isinstance(value, float):
        for extreme in extremes:
            yield f"{path} = {extreme:g}", extreme
    elif isinstance(value, dict | list | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            for where, other in changed(part, extremes, f"{path}.{key}"):
                if isinstance(value, dict):
                    yield where, {**value, key: other}
                else:
                    yield where, [*value[:key], other, *value[key + 1 :]]


def outcome(path: str, values: dict[str, Any]) -> str:
    try:
        return f"episode: {simulate(store.read_skill(path).skill, Scenario(**values)).outcome}"
    except SkillctlError as error:
        return f"{type(error).__name__}"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("skill", type=Path)
    parser.add_argument("--seconds", type=float, default=120.0, help="for each; the machine may be busy")
    parser.add_argument("--stride", type=int, default=1, help="every so many cases only")
    options = parser.parse_args()
    import scenarios  # a child finds functions in modules, not in this program

    seen, broken, began = Counter[str](), 0, time.monotonic()
    with Child(Limits(seconds=options.seconds)) as child:
        for where, values in [*changed(FULL, EXTREMES)][:: options.stride]:
            try:
                said = child.call(scenarios.outcome, str(options.skill), values)
            except (TimeoutError, ChildDiedError, ValueError, MemoryError) as error:
                broken += 1
                print(f"{where}: BROKE A RULE: {error!r}", flush=True)
                continue
            seen[said] += 1
    told = ", ".join(f"{what} {n}" for what, n in sorted(seen.items()))
    print(f"{told} ({time.monotonic() - began:.0f} s)\n{broken} broke a rule")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
