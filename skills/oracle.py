"""Print, as the report of a run, how often the best of several skills succeeds, if one knew how each ends."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

from skillctl.simulation.tally import wilson_interval


def main(tables: list[Path]) -> None:
    """Print the report of the oracle that chooses among the runs in tables of `skillctl simulate --table`."""
    runs = [list(csv.DictReader(table.open(encoding="utf-8"))) for table in tables]
    won = [any(row["success"] == "1" for row in rows) for rows in zip(*runs, strict=True)]
    report = {
        "successes": sum(won),
        "episodes": len(won),
        "interval": wilson_interval(sum(won), len(won)),
        "medians": {"time_to_target": None},
        "failures": {},
        "simulated_seconds": 0.0,
        "wall_seconds": 0.0,
    }
    print(json.dumps(report))


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
