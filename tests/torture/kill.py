"""Kill whoever writes to a store, and look at what is left: python tests/torture/kill.py --count 300

Processes that publish, tag, untag, remove, collect and lock are killed at random moments. Each operation is
killed, and interrupted, before every line of its program, and each of its calls to the system fails. Whole
commands are stopped at random. All that commands do goes on beside each other, and many writers publish at
once. After each, the store is read as a whole. The exit code is 1 if a rule was broken.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from beside import all_beside
from commands import stop_commands
from faults import every_call
from leftovers import Finding, Ledger, require_clean, require_sweepable
from lines import every_line
from processes import Tell, content, finished, forked, without_unnamed_files

from skillctl import store
from skillctl.errors import NotFoundError
from skillctl.usecases.lock import lock
from skillctl.usecases.versions import collect


def churn(root: Path, name: str, tell: Tell) -> None:
    """Publish, tag and remove for ever, telling what is about to happen and what has."""
    rng, registry, mine = random.Random(name), store.Registry(root), []
    if rng.random() < 0.5:
        without_unnamed_files()
    for index in range(1_000_000):
        data = content(name, index)
        tell(f"publishing {store.digest_of(data)}")
        published = registry.publish("reach", data)
        tell(f"published {published.version} {published.digest}")
        mine.append(published.version)
        if rng.random() < 0.3:
            tell(f"tagging release {published.version}")
            registry.tag("reach", published.version, "release")
            tell(f"tagged release {published.version}")
        if rng.random() < 0.1:
            tell("tagging release 0")
            with suppress(NotFoundError):
                registry.untag("reach", "release")
            tell("tagged release 0")
        if rng.random() < 0.1:
            lock(["reach"], path=root / "skillctl.lock", store=root)
        if rng.random() < 0.1:
            aliases = registry.aliases("reach").values()
            doomed = [version for version in registry.versions("reach")[:-4] if version not in aliases]
            tell(" ".join(["removing", *map(str, doomed)]))
            collect(["reach"], keep_last=4, keep_tagged=True, store=root)
            tell(" ".join(["removed", *map(str, doomed)]))
            mine = [version for version in mine if version not in doomed]
        if mine and rng.random() < 0.2:
            doomed_one = mine.pop(rng.randrange(len(mine)))
            tell(f"removing {doomed_one}")
            registry.remove("reach", [doomed_one])
            tell(f"removed {doomed_one}")


def random_kills(folder: Path, count: int, seed: int) -> Counter[str]:
    """Kill writers at random moments; return in the midst of what."""
    rng, seen = random.Random(seed), Counter[str]()
    ledger, root = Ledger(), folder
    for number in range(count):
        if number % 10 == 0:  # a new store now and then: reading a large one would take the time
            ledger, root = Ledger(), folder / f"{number}"
        child, told = forked(partial(churn, root, f"{seed}/{number}"))
        time.sleep(rng.uniform(0.0, 0.12))
        os.kill(child, signal.SIGKILL)
        code, lines = finished(child, told)
        if code != -signal.SIGKILL:
            raise Finding(f"the writer ended by itself with {code}: {lines[-3:]}")
        ledger.read(lines)
        seen[ledger.interrupted or "between two"] += 1
        seen["temporaries left"] += require_clean(root, ledger)
        require_sweepable(root, ledger, content("survivor", number))
    return seen


def at_once(folder: Path, writers: int, each: int) -> Counter[str]:
    """Let many processes publish in one store."""
    root, ledger = folder / "skills", Ledger()

    def write(writer: int, tell: Tell) -> None:
        for index in range(each):
            made = store.Registry(root).publish("reach", content(writer, index))
            tell(f"published {made.version} {made.digest}")

    for child, told in [forked(partial(write, writer)) for writer in range(writers)]:
        code, lines = finished(child, told)
        if code != 0 or len(lines) != each:
            raise Finding(f"a writer ended with {code} after {len(lines)} of {each} versions")
        ledger.read(lines)
    if sorted(ledger.there) != list(range(1, writers * each + 1)):
        raise Finding(f"the numbers have gaps: {sorted(ledger.there)}")
    if require_clean(root, ledger):
        raise Finding("temporaries were left")
    return Counter({"versions": len(ledger.there)})


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=300, help="kills at random moments")
    parser.add_argument("--commands", type=int, default=60, help="whole commands that are stopped")
    parser.add_argument("--stride", type=int, default=1, help="lines from one stop to the next")
    parser.add_argument("--seconds", type=float, default=60.0, help="of all commands beside each other")
    parser.add_argument("--writers", type=int, default=8, help="writers at once")
    parser.add_argument("--each", type=int, default=50, help="versions of each writer")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="the parts whose names contain this")
    options = parser.parse_args()
    stride = options.stride
    parts: dict[str, Callable[[Path], Counter[str]]] = {
        "killed at random": lambda folder: random_kills(folder, options.count, options.seed),
        "killed before a line": lambda folder: every_line(folder, signal.SIGKILL, stride),
        "interrupted before a line": lambda folder: every_line(folder, signal.SIGINT, stride),
        "terminated before a line": lambda folder: every_line(folder, signal.SIGTERM, 5 * stride),
        "commands stopped": lambda folder: stop_commands(folder, options.commands, options.seed),
        "a fault at a call": lambda folder: every_call(folder, stride),
        "beside each other": lambda folder: all_beside(folder, options.seconds),
        "writers at once": lambda folder: at_once(folder, options.writers, options.each),
    }
    broken = 0
    for name, part in parts.items():
        if (options.only or "") in name:
            broken += not report(name, part)
    return 1 if broken else 0


def report(name: str, part: Callable[[Path], Counter[str]]) -> bool:
    """Do one part in a directory of its own; print what came of it, and return whether all rules held."""
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        try:
            seen = part(Path(folder))
        except Finding as finding:
            print(f"{name}: BROKE A RULE: {finding}", flush=True)
            return False
    told = ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)
    print(f"{name}: {told} ({time.monotonic() - start:.0f} s)", flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
