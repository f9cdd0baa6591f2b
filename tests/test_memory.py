"""Too little memory is said in one sentence, with exit code 8, before anything is begun."""

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from skillctl import memory
from skillctl.cli.errors import describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.errors import ResourceError
from skillctl.learning import needs
from skillctl.learning.fit import fit
from skillctl.learning.needs import memory_of, require_affordable, seconds_of
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean

MIB = 2**20
ARCHIVED = Path(__file__).parent / "archives" / "v2" / "seds.h5"
ROWS = "t,x,y\n" + "".join(
    f"{i / 10},{(1 - i / 30) ** 2 / 4:.4f},{i * (30 - i) / 4000:.4f}\n" for i in range(31)
)

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def limited(tmp_path: Path) -> Run:
    """Run a command in an address space of some size, [bytes]."""
    (tmp_path / "motion.csv").write_text(ROWS)
    (tmp_path / "many.toml").write_text('[[skills]]\noutput = "a.h5"\ndata = "motion.csv"\n')
    (tmp_path / "seds.h5").write_bytes(ARCHIVED.read_bytes())

    def run(size: int, *words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "skillctl", *words],
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)),
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip

    return run


COMMANDS = {
    "learn": ("learn", "motion.csv", "-o", "made.h5", "--preset", "fast"),
    "learn many": ("learn", "--batch", "many.toml", "--jobs", "2"),
    "inspect": ("inspect", "seds.h5"),
    "verify-stability": ("verify-stability", "seds.h5", "seds.h5", "--jobs", "2"),
    "export": ("export", "seds.h5", "-o", "seds.npz"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_in_words_below_what_it_needs_to_start_and_works_with_it(
    limited: Run, tmp_path: Path, name: str
) -> None:
    before = {path.name for path in tmp_path.iterdir()}
    refused = limited(memory.START - MIB, *COMMANDS[name])
    assert (refused.returncode, refused.stdout) == (8, "")
    assert refused.stderr == (
        "error: the memory of this process is limited to 767 MiB; skillctl needs 768 MiB.\n"
        "hint: Raise the limit: ulimit -v unlimited\n"
    )
    assert {path.name for path in tmp_path.iterdir()} == before
    assert limited(memory.START, *COMMANDS[name]).returncode == 0


def test_help_needs_no_memory(limited: Run) -> None:
    assert limited(200 * MIB, "learn", "--help").returncode == 0


def test_memory_that_ends_on_the_way_is_said(limited: Run, tmp_path: Path) -> None:
    """A demonstration that fills the process that reads it: its error is told, not what NumPy says."""
    with (tmp_path / "motion.csv").open("w") as file:
        file.write("t," + ",".join(f"x{i}" for i in range(7)) + "\n")
        file.writelines(f"{i}" + f",{i / 2e6}" * 7 + "\n" for i in range(2_000_000))
    result = limited(memory.START, *COMMANDS["learn"])
    assert result.returncode in (5, 8)  # of the process that reads it, or of this one
    assert "Traceback" not in result.stderr
    assert "memory" in result.stderr


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("array"),
        OSError(12, "Cannot allocate memory"), RuntimeError("can't start new thread"),
        ImportError("libhdf5.so: failed to map segment from shared object"),
    ],
)  # fmt: skip
def test_every_form_of_it_has_one_sentence(error: Exception) -> None:
    try:
        raise ValueError("later") from error
    except ValueError as later:
        for each in (error, later):
            failure = describe(each)
            assert (failure.code, failure.message) == (ExitCode.STORE, "there is not enough memory.")
    assert describe(RuntimeError("odd")).code == ExitCode.INTERNAL


# What there is


def proc(tmp_path: Path, monkeypatch, groups: str) -> None:
    (tmp_path / "self").mkdir()
    (tmp_path / "self" / "cgroup").write_text(groups)
    (tmp_path / "self" / "status").write_text("VmPeak:\t9 kB\nVmSize:\t  1024 kB\n")
    (tmp_path / "meminfo").write_text("MemTotal: 99 kB\nMemAvailable:   4096 kB\n")
    for name, value in (("MEMINFO", "meminfo"), ("SELF", "self"), ("GROUPS", "groups")):
        monkeypatch.setattr(memory, name, tmp_path / value)


def test_what_is_available_is_the_least_of_machine_group_and_address_space(monkeypatch, tmp_path) -> None:
    proc(tmp_path, monkeypatch, "0::/a/b\n")
    assert memory.available() == 4096 * 1024
    (tmp_path / "groups" / "a" / "b").mkdir(parents=True)
    (tmp_path / "groups" / "a" / "memory.max").write_text(f"{3 * MIB}\n")  # of the group around it
    (tmp_path / "groups" / "a" / "memory.current").write_text(f"{2 * MIB}\n")
    (tmp_path / "groups" / "a" / "memory.stat").write_text(f"anon 5\ninactive_file {MIB}\nfile 7\n")
    (tmp_path / "groups" / "a" / "b" / "memory.max").write_text("max\n")
    assert memory.available() == 2 * MIB
    monkeypatch.setattr(memory, "_address_space", lambda: 2.5 * MIB)  # of which 1 MiB is taken
    assert memory.available() == 1.5 * MIB
    monkeypatch.setenv(memory.WORKERS, "4")  # these share the group, and have an address space each
    assert memory.available() == 0.5 * MIB


def test_groups_of_the_first_version_count_too(monkeypatch, tmp_path) -> None:
    proc(tmp_path, monkeypatch, "9:cpu:/\n4:memory:/gone\n0::/\n")
    (tmp_path / "groups" / "memory").mkdir(parents=True)
    (tmp_path / "groups" / "memory" / "memory.limit_in_bytes").write_text(f"{2 * MIB}\n")
    (tmp_path / "groups" / "memory" / "memory.usage_in_bytes").write_text(f"{MIB}\n")
    assert memory.available() == MIB


def test_a_machine_that_says_nothing_has_no_limit(monkeypatch, tmp_path) -> None:
    for name in ("MEMINFO", "SELF", "GROUPS"):
        monkeypatch.setattr(memory, name, tmp_path / "nowhere")
    monkeypatch.setattr(memory, "_address_space", lambda: np.inf)
    assert memory.available() == np.inf


def test_more_than_the_stated_share_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(memory, "available", lambda: 1000.0 * MIB)
    memory.require(800.0 * MIB, "a fit", "Less.")
    with pytest.raises(
        ResourceError,
        match=r"a fit needs about 801 MiB of memory; 1000 MiB are free, of which it may use 80%",
    ) as caught:
        memory.require(801.0 * MIB, "a fit", "Less.")
    assert caught.value.hint == "Less."


# What a fit needs


def motions(d: int, count: int) -> DemonstrationSet:
    rng, times = np.random.default_rng(0), np.linspace(0.0, 2.0, 100)
    share = times / 2
    eased = share**3 * (10 - 15 * share + 6 * share**2)
    start, aside = rng.standard_normal((2, d))
    made = []
    for _ in range(count):
        offset = (1 - eased)[:, None] * (start + 0.05 * rng.standard_normal(d))
        positions = offset + 0.4 * np.sin(np.pi * eased)[:, None] * aside
        made.append(Demonstration(times, positions, np.gradient(positions, times, axis=0)))
    return DemonstrationSet(tuple(made), Euclidean(tuple(f"x{i}" for i in range(d))))


PEAK = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("test_memory", sys.argv[1])
spec.loader.exec_module(tests := importlib.util.module_from_spec(spec))
from skillctl.learning import options
options.EFFORTS["fast"] = options.Effort(starts=1, probe_steps=1, polish_steps=1, samples=30, components=7)
d, k, count = map(int, sys.argv[2:5])
data, options = tests.motions(d, count), tests.quick(k, sys.argv[5])
def peak():  # of this program; getrusage counts what began it, too
    return int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
before = peak()
tests.fit(data, options)
print(peak() - before)
"""


def quick(k: int, objective) -> LearnOptions:
    return LearnOptions(
        n_components=k, preset="fast", objective=objective, metric="euclidean", coordinates="identity"
    )


@pytest.mark.parametrize(
    ("d", "k", "count", "objective"),
    [(10, 3, 7, "reproduction"), (6, 3, 30, "reproduction"), (20, 2, 8, "mse"), (30, 2, 4, "likelihood")],
)
def test_the_estimate_is_near_the_memory_that_a_fit_takes(d: int, k: int, count: int, objective) -> None:
    """Not below it, as then the system would end the process, and not above three times of it."""
    run = subprocess.run(
        [sys.executable, "-c", PEAK, __file__, *map(str, (d, k, count)), objective],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    taken = 1024 * int(run.stdout)
    assert taken > 50 * MIB  # so much that libraries loaded meanwhile do not matter
    assert taken <= memory_of(d, k, count, quick(k, objective)) <= 3 * taken


def test_fits_of_ordinary_sizes_are_far_from_any_limit(monkeypatch) -> None:
    for d in (2, 3, 6, 7):
        assert memory_of(d, 9, 30, LearnOptions(preset="quality")) < 1.5 * 2**30
        assert seconds_of(d, 9, 30, LearnOptions(preset="quality")) < 3600


def test_a_fit_that_is_too_large_is_refused_before_it_begins(monkeypatch) -> None:
    monkeypatch.setattr(memory, "available", lambda: 24.0 * 2**30)
    begun: list[str] = []
    with pytest.raises(ResourceError, match="a fit of 1 components in 150 dimensions needs about") as caught:
        fit(motions(150, 8), LearnOptions(), progress=lambda stage, *_: begun.append(stage))
    assert begun == []
    assert "--components" in caught.value.hint
    assert "--columns" in caught.value.hint
    monkeypatch.setattr(memory, "available", lambda: np.inf)
    with pytest.raises(ResourceError, match=r"takes about .* hours, and at most 24 are allowed"):
        require_affordable(150, 7, 100, LearnOptions())


def test_a_fit_that_takes_minutes_says_so_first(monkeypatch) -> None:
    monkeypatch.setattr(needs, "RATE", needs.RATE / 1e6)
    monkeypatch.setattr(needs, "LONGEST", np.inf)
    said: list[str] = []
    fit(motions(2, 2), quick(1, "likelihood"), progress=lambda stage, *_: said.append(stage))
    assert "minutes" in said[0]
    assert not any("minutes" in stage for stage in said[1:])
