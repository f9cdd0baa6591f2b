"""The tasks live in a module that is written to disk, as processes find them by name."""

from __future__ import annotations

import ast
import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from skillctl.workers import WorkerDied
from skillctl.workers.processes import run_in_processes

TASKS = """
import os, signal, time
from pathlib import Path

def square(item):
    return item * item

def dies_at_three(item):
    if item == 3:
        os.kill(os.getpid(), signal.SIGSEGV)
    return item * item

def dies_once(item):
    if item == 0 and not Path("died").exists():
        Path("died").touch()
        os._exit(1)
    return item

def refuses(item):
    raise ValueError(f"item {item}")

def threads(item):
    import numpy
    from threadpoolctl import threadpool_info
    return [pool["num_threads"] for pool in threadpool_info()]

def sleeps(item):
    Path(f"pid-{os.getpid()}").touch()
    time.sleep(60)
"""

BATCH = """
import sys
from pathlib import Path
from skillctl.workers.processes import run_in_processes
import worker_tasks

try:
    list(run_in_processes(worker_tasks.sleeps, [0, 1, 2, 3], 2))
except KeyboardInterrupt:
    sys.exit(130)
"""


PROGRAM = """
import numpy
from skillctl.workers.processes import run_in_processes
import worker_tasks

print(list(run_in_processes(worker_tasks.threads, [0], 1)))  # a program needs no guard
"""


@pytest.fixture
def tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    (tmp_path / "worker_tasks.py").write_text(TASKS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("worker_tasks")


@pytest.fixture(autouse=True)
def _forget_tasks() -> object:
    yield
    sys.modules.pop("worker_tasks", None)


@pytest.mark.parametrize("jobs", [1, 3])
def test_every_item_is_done_once_whatever_the_number_of_processes(tasks: ModuleType, jobs: int) -> None:
    assert sorted(run_in_processes(tasks.square, [4, 0, 2], jobs)) == [(0, 16), (1, 0), (2, 4)]


def test_a_crash_costs_its_own_item_only(tasks: ModuleType) -> None:
    results = dict(run_in_processes(tasks.dies_at_three, list(range(6)), 2))
    assert isinstance(results.pop(3), WorkerDied)
    assert results == {0: 0, 1: 1, 2: 4, 4: 16, 5: 25}


def test_who_was_only_near_a_crash_is_run_again(tasks: ModuleType) -> None:
    assert dict(run_in_processes(tasks.dies_once, [0, 1], 2)) == {0: 0, 1: 1}


def test_what_a_task_raises_is_raised_here(tasks: ModuleType) -> None:
    with pytest.raises(ValueError, match="item 7"):
        list(run_in_processes(tasks.refuses, [7], 1))


def test_a_worker_has_one_thread_even_if_the_program_has_loaded_its_libraries_first(
    tasks: ModuleType, tmp_path: Path
) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    surroundings = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    result = subprocess.run(
        [sys.executable, "program.py"], env=surroundings, capture_output=True, text=True, check=True
    )
    ((position, counts),) = ast.literal_eval(result.stdout)
    assert (position, set(counts)) == (0, {1})


def alive(pids: list[int]) -> list[int]:
    """Return which processes run; one that ended but is not yet waited for by anybody does not."""
    running = []
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if state != "Z":
            running.append(pid)
    return running


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes run")
@pytest.mark.parametrize("how", ["ctrl-c", "killed"])
def test_no_worker_outlives_a_batch(tasks: ModuleType, tmp_path: Path, how: str) -> None:
    """Ctrl-C in a terminal reaches the whole process group; a kill reaches the parent alone."""
    (tmp_path / "batch.py").write_text(BATCH)
    batch = subprocess.Popen(
        [sys.executable, "batch.py"], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while len(workers := list(tmp_path.glob("pid-*"))) < 2:
        assert batch.poll() is None
        time.sleep(0.02)
    if how == "ctrl-c":
        os.killpg(batch.pid, signal.SIGINT)
    else:
        batch.kill()
    _, complaints = batch.communicate(timeout=20)
    assert batch.returncode == (130 if how == "ctrl-c" else -signal.SIGKILL)
    assert complaints == "" or how == "killed"  # then Python itself mentions what could not be tidied up
    pids = [int(worker.name.partition("-")[2]) for worker in workers]
    deadline = time.monotonic() + 20
    while alive(pids) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert alive(pids) == []
