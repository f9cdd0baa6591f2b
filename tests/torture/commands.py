"""Stop whole commands at random moments of their run."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import specimens
from leftovers import Finding, Ledger, require_clean, require_sweepable
from processes import content

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM)


@dataclass
class Commands:
    """The commands that publish, always with other options, so that there is always something to do."""

    root: Path
    rng: random.Random
    words: dict[str, list[str]]
    seconds: dict[str, float] = field(default_factory=dict)

    def run(self, number: int, stop: signal.Signals | None) -> tuple[str, int, str]:
        """Run the next command, stopped or not; return its name, its exit code and what it said on stderr."""
        name = list(self.words)[number % len(self.words)]
        shares = f"{self.rng.uniform(0.1, 0.9)!r},{self.rng.uniform(0.1, 0.9)!r}"
        other = {
            "learn": ["--seed", f"{number}"],
            "merge": ["--weights", shares],
            "combine": ["--priors", shares],
        }
        where = ["--name", "reach", "--store", f"{self.root}"]
        line = [sys.executable, "-m", "skillctl", name, *self.words[name], *other[name], *where]
        start = time.monotonic()
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if stop is not None:
            time.sleep(self.rng.uniform(0, self.seconds[name]))
            process.send_signal(stop)
        _, said = process.communicate(timeout=120)
        if process.returncode == 0:
            self.seconds[name] = min(time.monotonic() - start, self.seconds.get(name, 600.0))
        return name, process.returncode, said


def stop_commands(folder: Path, count: int, seed: int) -> Counter[str]:
    """Kill, interrupt and terminate learn, merge and combine; return what became of them."""
    (inputs := folder / "inputs").mkdir()
    a = specimens.learned(inputs, "a", (0.2, 0.1), (0.0, 0.06), (0.0, 0.0))
    b = specimens.learned(inputs, "b", (-0.1, -0.2), (0.08, 0.0), (0.1, 0.05))
    words = {
        "learn": [*map(str, sorted(inputs.glob("a-*.csv"))), "--preset", "fast"],
        "merge": [f"{a}", f"{b}", "--target", "0,0"],
        "combine": [f"{a}", f"{b}"],
    }
    rng, seen, ledger = random.Random(seed), Counter[str](), Ledger()
    commands = Commands(folder / "skills", rng, words)
    for number in range(count + len(words)):
        stop = rng.choice(SIGNALS) if number >= len(words) else None
        name, code, said = commands.run(number, stop)
        require_told(name, code, said, commands.root, ledger)
        seen[f"{name} {'finished' if code == 0 else stop.name if stop else code}"] += 1
    require_sweepable(commands.root, ledger, content("survivor", 0))
    return seen


def require_told(name: str, code: int, said: str, root: Path, ledger: Ledger) -> None:
    """Raise Finding unless what a command said agrees with what it left."""
    # Before our first line a process dies of any signal, or Python says that it could not start.
    unstarted = code == 1 and said.startswith("Fatal Python error: init_")
    if not unstarted and code not in (0, 130, 143, -signal.SIGKILL, -signal.SIGINT, -signal.SIGTERM):
        raise Finding(f"{name} ended with {code}: {said}")
    new = ledger.see(root)
    if len(new) > 1 or (code == 0 and len(new) != 1):
        raise Finding(f"{name} ended with {code} and made the versions {new}: {said}")
    if code in (130, 143) and ("@" in said) != bool(new):
        raise Finding(f"{name} ended with {code}, made {new}, and said: {said}")
    require_clean(root, ledger, f"{name}, code {code}")
