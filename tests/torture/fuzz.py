"""Spoil real artifacts at random and read them: python tests/torture/fuzz.py --count 20000 --seed 0

Half of the files have the seal that the change broke, half are sealed again, so that the checks behind the
seal are reached. Each is read in a child with limits on time and memory. The same seed gives the same files;
a file that breaks a rule is saved, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parent))

import specimens
from edits import INSIDE
from judging import CRASH, FAILURES, FINE, HANG, SEAL, judge, sealed_again, stated
from mutations import ANYWHERE, header

HANG_SECONDS = 30.0  # of waiting; the machine may be busy
MEMORY = 256 << 20  # bytes beyond what the program needs before it reads anything
PROVED_SHARE = 8  # one in so many accepted files is proved, too

PLAIN = [*ANYWHERE, "header", *INSIDE]
RESEALED = [*ANYWHERE, *INSIDE, *INSIDE]  # where the checks behind the seal are reached, more often


@dataclass(frozen=True)
class Case:
    """One spoiled file: what it was, and what was done to it."""

    index: int
    kind: str
    mutation: str
    resealed: bool

    @property
    def label(self) -> str:
        return f"{self.mutation}, resealed" if self.resealed else self.mutation


def case(seed: int, index: int, kinds: list[str]) -> tuple[Case, Random]:
    rng = Random(f"{seed}/{index}")
    resealed = index % 2 == 1
    return Case(index, rng.choice(kinds), rng.choice(RESEALED if resealed else PLAIN), resealed), rng


def spoiled(case: Case, rng: Random, goods: dict[str, bytes]) -> bytes:
    """Return the bytes of a case, its seal made again if it has to be."""
    good, others = goods[case.kind], list(goods.values())
    mutate = {**ANYWHERE, "header": header, **INSIDE}[case.mutation]
    if not case.resealed:
        return mutate(rng, good, others)
    if case.mutation in ANYWHERE:
        bodies = [other[SEAL:] for other in others]
        changed = good[:SEAL] + mutate(rng, good[SEAL:], bodies)
    else:
        changed = mutate(rng, good, others)
    return sealed_again(changed, *stated(good))


# ---------------------------------------------------------------------------------------------------------
# The child: reads numbers of cases, answers with outcomes


def serve(seed: int, folder: Path) -> None:
    faulthandler.enable()
    goods = {path.stem: path.read_bytes() for path in sorted(folder.glob("*.h5"))}
    warm = goods[min(goods)]
    judge(warm + b"\0", warm, prove=True)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY,) * 2)
    warnings.simplefilter("error")
    for line in sys.stdin:
        one, rng = case(seed, int(line), sorted(goods))
        data = spoiled(one, rng, goods)
        verdict = judge(data, goods[one.kind], prove=one.index // 2 % PROVED_SHARE == 0)
        print(json.dumps([verdict.outcome, verdict.detail]), flush=True)


class Child:
    """A process that judges cases; replaced when it dies or never answers."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - lives as long as the process
        command = [sys.executable, __file__, "--child", str(folder), "--seed", str(seed)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors, text=True, bufsize=1
        )

    def judge(self, index: int) -> tuple[str, str]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(f"{index}\n")
        except BrokenPipeError:
            return CRASH, self.said()
        ready, _, _ = select.select([self.process.stdout], [], [], HANG_SECONDS)
        if not ready:
            return HANG, f"no answer in {HANG_SECONDS:.0f} s"
        line = self.process.stdout.readline()
        if not line:
            return CRASH, self.said()
        outcome, detail = json.loads(line)
        return outcome, detail

    def said(self) -> str:
        code = self.process.wait()
        self.errors.seek(0)
        return f"exit code {code}: {self.errors.read()[-2000:]}"

    def stop(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.errors.close()


# ---------------------------------------------------------------------------------------------------------
# The parent: asks children, counts, and keeps what must not happen


@dataclass
class Tally:
    """What came of all cases."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)  # by mutation
    kinds: Counter[tuple[str, str]] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def add(self, one: Case, outcome: str, detail: str) -> None:
        self.outcomes[one.label, outcome] += 1
        self.kinds[one.kind, outcome] += 1
        if outcome == "refused":
            self.errors[detail] += 1


def keep(folder: Path, seed: int, one: Case, goods: dict[str, bytes], outcome: str, detail: str) -> str:
    """Save a file that breaks a rule; return what to tell about it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{seed}-{one.index}-{re.sub(r'[^a-z0-9]+', '-', f'{outcome} {one.label}'.lower())}.h5"
    _, rng = case(seed, one.index, sorted(goods))
    path.write_bytes(spoiled(one, rng, goods))
    return f"{outcome}: {one.kind}, {one.label}, case {one.index}: {path}\n{detail}"


def run(seed: int, indices: range, goods: dict[str, bytes], folder: Path, saved: Path) -> Tally:
    """Let one child after the other judge cases."""
    tally, child = Tally(), Child(seed, folder)
    for index in indices:
        one, _ = case(seed, index, sorted(goods))
        outcome, detail = child.judge(index)
        tally.add(one, outcome, detail)
        if outcome not in FINE:
            tally.failures.append(keep(saved, seed, one, goods, outcome, detail))
        if outcome in (CRASH, HANG):
            child.stop()
            child = Child(seed, folder)
    child.stop()
    return tally


def table(heading: str, counts: Counter[tuple[str, str]]) -> str:
    columns = [outcome for outcome in (*FINE, *FAILURES) if any(found == outcome for _, found in counts)]
    rows = sorted({name for name, _ in counts})
    width = max(map(len, [*rows, heading]))

    def line(name: str, cells: list[str]) -> str:
        padded = (cell.rjust(max(8, len(c))) for cell, c in zip(cells, columns, strict=True))
        return " ".join([name.ljust(width), *padded])

    sums = [sum(n for (_, found), n in counts.items() if found == c) for c in columns]
    body = [line(row, [str(counts[row, c]) for c in columns]) for row in rows]
    return "\n".join([line(heading, columns), *body, line("all", list(map(str, sums)))])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=20_000, help="spoiled files to read")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="judge one case again, by its number")
    parser.add_argument("--jobs", type=int, default=1, help="children at once")
    parser.add_argument("--save", type=Path, default=Path("spoiled"), help="where files that break a rule go")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        serve(options.seed, options.child)
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        goods = specimens.make(Path(scratch))
        (folder := Path(scratch) / "goods").mkdir()
        for kind, data in goods.items():
            (folder / f"{kind}.h5").write_bytes(data)
        return fuzz(options, goods, folder)


def fuzz(options: argparse.Namespace, goods: dict[str, bytes], folder: Path) -> int:
    start = time.monotonic()
    shares = [range(job, options.count, options.jobs) for job in range(options.jobs)]
    if options.only is not None:
        shares = [range(options.only, options.only + 1)]
    with ThreadPoolExecutor(len(shares)) as pool:  # a thread only waits for its child
        tallies = list(pool.map(lambda share: run(options.seed, share, goods, folder, options.save), shares))
    total = Tally()
    for tally in tallies:
        total.outcomes += tally.outcomes
        total.kinds += tally.kinds
        total.errors += tally.errors
        total.failures += tally.failures
    print(table("mutation", total.outcomes), table("artifact", total.kinds), sep="\n\n", end="\n\n")
    print(", ".join(f"{name} {n}" for name, n in sorted(total.errors.items())))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = f"{time.monotonic() - start:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of CPU"
    print(f"{sum(total.outcomes.values())} files in {times}, seed {options.seed}")
    print(f"{len(total.failures)} broke a rule")
    for failure in total.failures:
        print(failure, file=sys.stderr)
    return 1 if total.failures else 0


if __name__ == "__main__":
    sys.exit(main())
