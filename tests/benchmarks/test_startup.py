"""How long commands take before they do anything, in units of what cannot be avoided.

    python -m pytest tests/benchmarks/test_startup.py -s

CPU time of whole processes, all kinds in turn in one run, so that a busy machine slows all alike. The
medians and their ratios are what counts; which modules are loaded is held by tests/test_imports.py.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys

import pytest

from skillctl.workers.threads import THREAD_VARIABLES

REPEATS = 11

BARE, TYPER, HDF5 = "python -c pass", "import typer", "import h5py"
PROGRAMS = {BARE: "pass", TYPER: "import typer", HDF5: "import h5py"}
COMMANDS = {
    "--version": ["--version"],
    "--help": ["--help"],
    "learn --help": ["learn", "--help"],
    "ls": ["ls"],
    "TAB": ["__complete", "words", "inspect", "cur"],
    "inspect": ["inspect", "curve"],
    "verify-stability": ["verify-stability", "curve"],
}
# What a command may cost at most, as a multiple of something else. For inspect 1.6 was aimed at; pydantic,
# which checks what a file claims before it is believed, costs 0.6 of it alone.
BUDGET = {"--version": (BARE, 3.0), "--help": (TYPER, 2.5), "inspect": (HDF5, 2.5)}


def cpu_seconds(command, environment):
    """Return the user and system time of one process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.timeout(120)
def test_starting_costs_little_more_than_what_is_needed(library, capsys):
    surroundings = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}
    environment = {**surroundings, "SKILLCTL_STORE": str(library)}  # as a user has it
    lines = {name: [sys.executable, "-c", code] for name, code in PROGRAMS.items()}
    lines |= {name: [sys.executable, "-m", "skillctl", *words] for name, words in COMMANDS.items()}
    measured: dict[str, list[float]] = {name: [] for name in lines}
    for _ in range(REPEATS):
        for name, line in lines.items():
            measured[name].append(cpu_seconds(line, environment))
    median = {name: statistics.median(values) for name, values in measured.items()}
    with capsys.disabled():
        print("\n" + table(median))
    for name, (unit, most) in BUDGET.items():
        assert median[name] <= most * median[unit], table(median)


def table(median):
    """Return the table for people."""
    rows = []
    for name, seconds in median.items():
        unit, most = BUDGET.get(name, (None, None))
        ratio = "" if unit is None else f"{seconds / median[unit]:5.2f} of at most {most} times {unit}"
        rows.append(f"{name:<18}{1e3 * seconds:6.0f} ms  {ratio}".rstrip())
    return "\n".join(rows)
