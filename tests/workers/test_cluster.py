"""A cluster of the documented recipe: who can reach it, and what happens when it gives no sign of life."""

from __future__ import annotations

import importlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="needs the extra 'cluster'")

from skillctl.errors import StoreError
from skillctl.workers import Workers

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "skillctl" / "docs" / "pipelines.md").read_text(encoding="utf-8")
TASKS = """
import os, time
def slow(item):
    time.sleep(item)
    return os.getpid()
def late(item):
    raise TimeoutError("of its own")
"""
PATIENCE = 2.0  # [s]


@dataclass
class Cluster:
    """The processes of the recipe, in sessions of their own.

    Attributes:
        address: Of the scheduler.
        scheduler, workers: The processes that were started; the second starts the workers.
    """

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: subprocess.Popen[bytes]

    def signal(self, whom: str, number: signal.Signals) -> None:
        os.killpg(getattr(self, whom).pid, number)


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    (tmp_path / "cluster_tasks.py").write_text(TASKS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{ROOT}")
    monkeypatch.setenv("DASK_TEMPORARY_DIRECTORY", str(tmp_path / "dask"))
    scheduler, workers = re.findall(r"^dask (scheduler|worker)( .*)$", PAGE, re.MULTILINE)
    port = free_port()
    started = []
    for kind, options in (scheduler, workers):
        options = options.replace("8786", str(port)).replace("8787", "0").replace("--nworkers 2", "")
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options.split()]
        started.append(
            subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
            )
        )
    running = Cluster(f"tcp://127.0.0.1:{port}", *started)
    try:
        wait_for_worker(running.address)
        yield running
    finally:
        for process in started:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        sys.modules.pop("cluster_tasks", None)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def wait_for_worker(address: str) -> None:
    from distributed import Client

    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            with Client(address, timeout=5, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=30)
                return
        except OSError:
            time.sleep(0.1)
    raise AssertionError("the cluster does not start")


def tasks():
    return importlib.import_module("cluster_tasks")


def listening(session: int) -> set[str]:
    """Return the addresses on which the processes of a session listen, in the kernel's form."""
    sockets: set[str] = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(process.name)) == session:
                links = [str(entry.readlink()) for entry in (process / "fd").iterdir()]
                sockets |= {link[8:-1] for link in links if link.startswith("socket:[")}
        except OSError:  # it has ended
            continue
    found = set()
    for table in ("tcp", "tcp6"):
        for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = row.split()
            if columns[3] == "0A" and columns[9] in sockets:
                found.add(columns[1].partition(":")[0])
    return found


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads Linux's table of sockets")
def test_the_cluster_of_the_page_listens_to_this_machine_only(cluster: Cluster) -> None:
    loopback = "0100007F"  # 127.0.0.1
    assert listening(cluster.scheduler.pid) == {loopback}
    assert listening(cluster.workers.pid) == {loopback}


@pytest.mark.parametrize(
    ("whom", "number", "words"),
    [
        ("scheduler", signal.SIGSTOP, "the scheduler at tcp://127.0.0.1:[0-9]+ does not answer"),
        ("workers", signal.SIGSTOP, "none of its workers answers"),
        ("workers", signal.SIGKILL, "the scheduler at tcp://127.0.0.1:[0-9]+ has no worker"),
    ],
)
def test_a_cluster_without_a_sign_of_life_is_given_up_and_this_is_told(
    cluster: Cluster, whom: str, number: signal.Signals, words: str
) -> None:
    told: list[str] = []
    workers = Workers(scheduler=cluster.address, patience=PATIENCE)
    with pytest.raises(StoreError, match=f"no sign of life for 2 s: {words}") as caught:
        workers.run(
            tasks().slow, [0.0, 600.0], done=lambda *_: cluster.signal(whom, number), waiting=told.append
        )
    assert "--patience" in caught.value.hint
    assert told
    assert all(re.fullmatch(f"waiting, ({words}|none of its workers answers)", line) for line in told)


def test_a_busy_worker_is_waited_for_and_a_late_task_is_no_late_cluster(cluster: Cluster) -> None:
    workers = Workers(scheduler=cluster.address, patience=PATIENCE)
    first, second = workers.run(tasks().slow, [0.0, 2.5 * PATIENCE])
    assert first == second
    with pytest.raises(TimeoutError, match="of its own"):
        workers.run(tasks().late, [0])


def test_a_scheduler_that_dies_is_one_sentence_and_what_was_learned_stays(
    cluster: Cluster, tmp_path: Path, curve_files
) -> None:
    entry = "[[skills]]\nname = 's{}'\ndata = '{}'\nseed = {}\n"
    skills = [entry.format(i, curve_files[0].parent / "curve-*.csv", i) for i in range(40)]
    (tmp_path / "many.toml").write_text("[options]\npreset = 'fast'\n" + "".join(skills))
    (tmp_path / "skills").mkdir()
    line = [sys.executable, "-m", "skillctl", "-v", "learn", "--batch", "many.toml", "--backend", "dask"]
    line += ["--scheduler", cluster.address]
    said = []
    with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as command:
        for text in command.stderr:
            said.append(text)
            if " learned" in text and cluster.scheduler.poll() is None:
                cluster.scheduler.kill()
                cluster.scheduler.wait()
    assert command.returncode == 8
    assert "Traceback" not in "".join(said)
    (error,) = [text for text in said if text.startswith("error: ")]
    published = sorted(f"{path.parent.name}@1" for path in tmp_path.glob("skills/*/1.h5"))
    assert error.startswith("error: the cluster was lost. All the same, ")
    assert sorted(re.findall(r"s\d+@1", error)) == published
    assert published
