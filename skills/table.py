"""Print the table of the experiment, in Markdown, from what `skillctl simulate --json` wrote."""

from __future__ import annotations

import json
import sys
from pathlib import Path

HEADINGS = ("skill", "scenario", "succeeded", "95 % interval", "median time", "failures")


def row(path: Path) -> tuple[str, ...]:
    """Return the cells of the row of one run."""
    report = json.loads(path.read_text(encoding="utf-8"))
    skill, scenario = path.stem.split("--")
    low, high = report["interval"]
    time = report["medians"]["time_to_target"]
    failures = [f"{count} {kind}" for kind, count in report["failures"].items()]
    lost = report.get("lost", {})
    if lost.get("stood"):
        failures.append(f"{lost['succeeded']} of {lost['stood']} lost cups that stood in reach set down")
    return (
        skill,
        scenario,
        f"{report['successes']} of {report['episodes']}",
        f"{low:.0%} to {high:.0%}".replace("%", " %"),
        "–" if time is None else f"{time:.2f} s",
        ", ".join(failures) or "–",
    )


def main(paths: list[Path]) -> None:
    """Print one line for each run, and the time of all runs together."""
    rows = [row(path) for path in paths]
    widths = [max(map(len, column)) for column in zip(HEADINGS, *rows, strict=True)]
    for cells in (HEADINGS, tuple("-" * width for width in widths), *rows):
        print("|", " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)), "|")
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    simulated = sum(report["simulated_seconds"] for report in reports)
    wall = sum(report["wall_seconds"] for report in reports)
    print(
        f"\n{simulated:.0f} s simulated in {wall:.0f} s: {simulated / max(wall, 1e-9):.1f} times real time."
    )


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
