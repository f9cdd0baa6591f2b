"""Random commands of all kinds on one store, at once and in trouble: python tests/torture/soak.py --hours 2

Commands are killed, interrupted and terminated; their memory and files are limited; the disk is full from a
random change on. With --fill, in a DIR on a small file system, it really is now and then. After each round an
independent reader looks at the store, and whether all is true that the commands have said. The exit code is 1
if something is not.
"""

from __future__ import annotations

import argparse
import json
import os
import pkgutil
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NoReturn

sys.path.insert(0, str(Path(__file__).parents[2]))  # this checkout's package, wherever another is installed
sys.path.insert(0, str(Path(__file__).parent))

import full_disk
import specimens
from independent import Broken, read_artifact, read_store
from promises import MAKING, Command, Promises

import skillctl
from skillctl.__main__ import main as main_of_skillctl

ROOT = Path(__file__).parents[2]
Pipe, Process = get_context("fork").Pipe, get_context("fork").Process
LEARNED = {"a": ((0.2, 0.1), (0.0, 0.06), (0.0, 0.0)), "b": ((-0.1, -0.2), (0.08, 0.0), (0.1, 0.05))}
NAMES = (*LEARNED, "both", "either", "course", "task")
ALIASES = ("release", "next")
VERBS = {
    "learn": 8, "merge": 4, "combine": 4, "chain": 3, "adapt": 2, "tag": 5, "untag": 2, "rm": 2, "gc": 2,
    "lock": 3, "ls": 3, "log": 2, "inspect": 2, "export": 3, "verify-stability": 2, "diff": 1,
}  # fmt: skip
TROUBLES = {
    "": 16, "SIGKILL": 4, "SIGTERM": 3, "SIGINT": 2, "full disk": 4, "small files": 2, "little memory": 3,
}  # fmt: skip


STOPS = (signal.SIGINT, signal.SIGTERM)
WHOLE = ("", "SIGKILL", "SIGTERM", "SIGINT")  # also of a Python that starts


@dataclass
class Soak:
    """The store, its users, and what they have said.

    Attributes:
        folder: The store and all files that commands write are in it.
        inputs: Demonstrations and a task.
        full: Whether the file system is filled now and then.
        log: Where each command is written down.
    """

    folder: Path
    inputs: Path
    seed: int
    promises: Promises = field(default_factory=Promises)
    seen: Counter[str] = field(default_factory=Counter)
    full: bool = False
    log: Path | None = None

    @property
    def store(self) -> Path:
        return self.folder / "skills"

    def prepare(self) -> None:
        """Write demonstrations and a task, and learn the first skills."""
        for name, (start, bend, end) in LEARNED.items():
            for i in range(2):
                begins = (start[0] + i / 50, *start[1:])
                specimens.write_motion(self.inputs / f"{name}-{i}.csv", begins, bend, end)
        low, high = LEARNED["a"][0], (LEARNED["a"][0][0] + 0.02, LEARNED["a"][0][1])
        (self.inputs / "task.toml").write_text(
            f"[target]\nposition = [0.0, 0.0]\n[start]\nlow = {list(low)}\nhigh = {list(high)}\n"
        )
        self.folder.mkdir(exist_ok=True)
        for name in LEARNED:
            data = [f"{self.inputs / f'{name}-{i}.csv'}" for i in range(2)]
            first = Command(["learn", *data, "--preset", "fast", "--components", "2", "--name", name], name)
            self.run(first, random.Random(), self.folder)
            self.promises.judge(first, full=False)

    def use(self, user: int, until: float, tell: Connection) -> None:
        """Run commands one after the other, and tell of each, and of files that are not whole."""
        rng = random.Random(f"{self.seed}/{user}/{until}")
        own = self.folder / f"user-{user}"
        own.mkdir(exist_ok=True)
        while time.monotonic() < until:
            words, name, note = self.chosen(rng, user)
            command = Command(words, name, note, rng.choices(list(TROUBLES), list(TROUBLES.values()))[0])
            whole = command.trouble in WHOLE and rng.random() < 0.1
            self.run(command, rng, own, whole=whole)
            tell.send((command, list(broken_files(own, command))))
        tell.send(None)

    def told(self, users: Sequence[Connection]) -> None:
        """Take note of all that users tell, until each has stopped."""
        going = list(users)
        while going:
            for each in wait(going):
                assert isinstance(each, Connection)
                if (said := each.recv()) is None:
                    going.remove(each)
                    continue
                command, broken = said
                if self.log is not None:
                    with self.log.open("a") as log:
                        log.write(json.dumps(asdict(command)) + "\n")
                self.promises.judge(command, self.full)
                for finding in broken:
                    self.promises.find(finding)
                self.seen[command.verb] += 1
                self.seen[f"in trouble: {command.trouble}"] += bool(command.trouble)
                self.seen[f"exit code {command.code}"] += 1

    def chosen(self, rng: random.Random, user: int) -> tuple[list[str], str, str]:
        """Return a command, the skill that it changes, and the note of the one that it makes."""
        verb = rng.choices(list(VERBS), list(VERBS.values()))[0]
        name, note = rng.choice(NAMES), f"user {user}, {rng.getrandbits(60):x}"
        new = ["-m", note]
        alias, version = rng.choice(ALIASES), f"{name}@{self.number(rng, name)}"
        a, b = (self.reference(rng, each) for each in rng.sample(NAMES[:3], 2))
        if verb in MAKING and rng.random() < 0.2:
            target = ["-o", f"{rng.choice('xyz')}.h5"]
            published = ""
        else:
            made = {"merge": "both", "combine": "either", "chain": "course", "adapt": "task"}
            made["learn"] = rng.choice(list(LEARNED))
            target = ["--name", published := made.get(verb, "")]
        data = [f"{self.inputs / f'{published or name}-{i}.csv'}" for i in range(2)]
        if verb == "learn" and not published:
            data = [f"{self.inputs / f'a-{i}.csv'}" for i in range(2)]
        words = {
            "learn": [*data, "--preset", "fast", "--components", "2", *new, *target],
            "merge": [a, b, *new, *target],
            "combine": [a, b, *new, *target],
            "chain": [a, b, "--event", "1:close", *new, *target],
            "adapt": [f"{self.inputs / 'task.toml'}", a, b, "--anyway", *new, *target],
            "tag": [version, alias],
            "untag": [name, alias],
            "rm": [version] if rng.random() < 0.5 else [version, "--force"],
            "gc": [*([] if rng.random() < 0.5 else [name]), "--keep-last", f"{rng.randint(1, 6)}"],
            "lock": ["--file", rng.choice((f"{self.folder / 'shared.lock'}", "own.lock"))],
            "ls": ["--check"] if rng.random() < 0.5 else [],
            "log": [name],
            "inspect": [self.reference(rng, name)],
            "export": [self.reference(rng, name), "-o", f"out.{rng.choice(('json', 'npz'))}"],
            "verify-stability": [a, b, "--require", "local"],
            "diff": [a, b],
        }[verb]
        if verb == "gc" and rng.random() < 0.5:
            words.append("--keep-tagged")
        if verb == "rm" and rng.random() < 0.05:
            words = ["--all", name, "--force"]
        if verb == "export" and name in LEARNED and rng.random() < 0.3:
            words[-1] = "out.mat"
        changes = {"rm": name, "tag": name, "untag": name, "gc": name if name in words else ""}
        return [verb, *words], changes.get(verb, published), note if published else ""

    def number(self, rng: random.Random, name: str) -> int:
        """Return a number of a version: mostly one of the last."""
        given = [int(p.stem) for p in (self.store / name).glob("*.h5")] or [1]
        return max(1, max(given) - rng.choice((-1, 0, 0, 0, 1, 1, 2, 3)))

    def reference(self, rng: random.Random, name: str) -> str:
        return rng.choice((name, name, f"{name}@{self.number(rng, name)}", f"{name}@{rng.choice(ALIASES)}"))

    def run(self, command: Command, rng: random.Random, own: Path, *, whole: bool = False) -> None:
        """Run a command in its trouble, and note how it ended.

        Args:
            command: It has not begun.
            rng: Decides the trouble.
            own: The directory it runs in, beside which its output is kept.
            whole: Start a Python of its own; else it is a copy of this process, which has loaded everything.
        """
        output = [self.inputs / f"{own.name}.{stream}" for stream in ("out", "err")]
        command.began = time.monotonic()
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
        with output[0].open("wb") as out, output[1].open("wb") as err:
            if whole:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
                line = [sys.executable, "-m", "skillctl", *command.words, "--json"]
                environment = {**os.environ, "PYTHONPATH": f"{ROOT}", "SKILLCTL_STORE": f"{self.store}"}
                process = subprocess.Popen(line, cwd=own, env=environment, stdout=out, stderr=err).pid
            elif not (process := os.fork()):
                become(command, self.store, own, (out.fileno(), err.fileno()), rng)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        if command.trouble.startswith("SIG"):
            time.sleep(rng.uniform(0, 2.0 if whole else 1.0) ** 2 / 2)  # mostly while it runs
            os.kill(process, getattr(signal, command.trouble))
        command.code = ended(process)
        command.ended = time.monotonic()
        printed, command.said = (path.read_text(errors="replace") for path in output)
        try:
            command.document = json.loads(printed)
        except ValueError:
            command.document = None

    def look(self) -> None:
        """Look at the store, to which nobody is writing."""
        try:
            store = read_store(self.store)
        except Broken as broken:
            self.promises.find(f"{broken}")
            return
        self.promises.compare(store)
        self.seen["looks at the store"] += 1
        self.seen["versions read"] += sum(len(folder.versions) for folder in store.values())
        temporary = sum(folder.temporary for folder in store.values())
        kills = sum(command.code < 0 for command in self.promises.commands)
        if temporary > kills:
            self.promises.find(f"{temporary} temporary files after {kills} kills")

    def fill(self, until: float) -> None:
        """Fill the file system now and then, and make room again."""
        ballast, rng = self.folder / "ballast", random.Random(f"{self.seed}/{until}")
        while time.monotonic() < until:
            time.sleep(rng.uniform(0.5, 3.0))
            try:
                with ballast.open("wb", buffering=0) as file:
                    while file.write(bytes(1 << rng.randint(10, 16))):
                        pass
            except OSError:  # it is full
                pass
            time.sleep(rng.uniform(0.2, 2.0))
            ballast.unlink()


def become(command: Command, store: Path, own: Path, output: tuple[int, int], rng: random.Random) -> NoReturn:
    """Be the process of a command from here on, and end as it."""
    code: Any = 70
    try:
        for descriptor, stream in zip(output, (1, 2), strict=True):
            os.dup2(descriptor, stream)
        os.chdir(own)
        os.environ["SKILLCTL_STORE"] = str(store)
        if command.trouble == "full disk":
            full_disk.fill_after(rng.randint(0, 9))
        elif command.trouble == "small files":
            resource.setrlimit(resource.RLIMIT_FSIZE, (rng.randint(0, 40) << 10,) * 2)
        elif command.trouble == "little memory":
            taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (taken + (rng.randint(4, 32) << 20),) * 2)
        sys.argv = ["skillctl", *command.words, "--json"]
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        main_of_skillctl()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    except KeyboardInterrupt:  # before the first line of the command
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        traceback.print_exc()
    finally:
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
        sys.stderr.flush()
        os._exit(code)


def ended(process: int) -> int:
    """Wait for a process, and kill it after five minutes; return its exit code, or minus its signal."""
    patience = time.monotonic() + 300
    while not (status := os.waitpid(process, os.WNOHANG))[0]:
        if time.monotonic() > patience:
            os.kill(process, signal.SIGKILL)
        time.sleep(0.01)
    return os.waitstatus_to_exitcode(status[1])


def broken_files(own: Path, command: Command) -> Iterator[str]:
    """Look at the files that a user writes beside the store: each is whole, with nothing beside it."""
    for path in own.iterdir():
        if path.name.endswith(".tmp") and command.code == -signal.SIGKILL:
            path.unlink()
            continue
        try:
            require_whole(path)
        except Exception as error:  # of whichever reader
            yield f"{command} left {path}: {error!r}"
            path.unlink()


def require_whole(path: Path) -> None:
    """Raise an exception unless a file is whole, after its name."""
    data = path.read_bytes()
    suffix = path.suffix[1:]
    if suffix == "h5":
        read_artifact(data)
    elif suffix == "json":
        json.loads(data)
    elif suffix == "npz":
        import numpy as np

        with np.load(path, allow_pickle=False) as arrays:
            for name in arrays.files:
                arrays[name]
    elif suffix == "mat":
        from scipy.io import loadmat

        loadmat(path)
    elif suffix == "lock":
        from independent import tomllib

        assert tomllib.loads(data.decode())["format"] == 1
    else:
        raise Broken("it is nothing that a command should leave")


def soak(folder: Path, seconds: float, options: argparse.Namespace) -> Soak:
    """Let users work for some time, in rounds; after each, look at the store."""
    end, users, pause, filled = time.monotonic() + seconds, options.users, options.pause, options.fill
    with tempfile.TemporaryDirectory() as inputs:
        soak = Soak(folder, Path(inputs), options.seed, full=filled, log=options.log)
        soak.prepare()
        while (now := time.monotonic()) < end:
            until = min(now + pause, end)
            pipes = [Pipe(duplex=False) for _ in range(users)]
            work = [Process(target=soak.use, args=(user, until, pipes[user][1])) for user in range(users)]
            if filled:
                work.append(Process(target=soak.fill, args=(until,)))
            for each in work:
                each.start()
            soak.told([receiving for receiving, _ in pipes])
            for each in work:
                each.join()
            soak.look()
    return soak


def load_everything() -> None:
    """Import all modules, so that a copy of this process need not."""
    for module in pkgutil.walk_packages(skillctl.__path__, "skillctl."):
        with suppress(ImportError):  # of an optional package
            import_module(module.name)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, help="instead of hours")
    parser.add_argument("--users", type=int, default=8, help="commands at once")
    parser.add_argument("--pause", type=float, default=30.0, help="seconds from one look to the next")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="keep the store here; default: a temporary directory")
    parser.add_argument("--log", type=Path, help="write down every command, one JSON document a line")
    parser.add_argument("--fill", action="store_true", help="fill the file system of --folder now and then")
    options = parser.parse_args()
    if options.fill and options.folder is None:
        parser.error("--fill needs a --folder on a small file system of its own")
    seconds = 3600 * options.hours if options.seconds is None else options.seconds
    began = time.monotonic()
    load_everything()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background ignores it
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        done = soak(folder, seconds, options)
    for what, count in sorted(done.seen.items()):
        print(f"{what}: {count}")
    print(f"{len(done.promises.commands)} commands in {(time.monotonic() - began) / 60:.1f} minutes")
    for finding, count in done.promises.findings.most_common():
        print(f"FOUND {count} times: {finding}")
    return 1 if done.promises.findings else 0


if __name__ == "__main__":
    sys.exit(main())
