"""Work on a Dask cluster, whose workers must have the same directory, files and versions as this process."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from queue import Empty, SimpleQueue
from typing import Any

import skillctl
from skillctl.errors import NotFoundError, StoreError, UsageError, printable
from skillctl.workers import Item, Result, WorkerDied
from skillctl.workers.blas import one_blas_thread

TIMEOUT = 10.0  # [s], for a scheduler to answer, and for a first worker
LOOK = 1.0  # [s], from one look at a cluster to the next; a worker is heard of every half second
LOOKS = 4  # that a scheduler does not answer, before the patience is lost
LATE = (TimeoutError, asyncio.TimeoutError)
ADDRESS = re.compile(r"([a-z]+://)?(\[[0-9a-f:]+\]|[^\s:/]+):\d{1,5}/?")
DECIDING = ("numpy", "scipy", "pybullet")  # their versions decide the last digits

_one_at_a_time = threading.Lock()  # threads of one worker share standard output


def run_on_cluster(
    task: Callable[[Item], Result],
    items: Sequence[Item],
    scheduler: str,
    patience: float,
    waiting: Callable[[str], None] | None = None,
) -> Generator[tuple[int, Result | WorkerDied], None, None]:
    """Yield (position, task(item)) for every item, in the order in which they are done.

    When a worker dies, the scheduler tries its items elsewhere, three times unless configured otherwise. Then
    it gives up all items of the last worker, whichever of them was the cause. These items are run again
    one at a time; an item whose worker dies then has caused it.

    Args:
        task: Picklable.
        items: Arguments of ``task``, picklable.
        scheduler: Its address.
        patience: How long the scheduler, or all workers, may give no sign of life, [s]. A worker that is busy
            gives them.
        waiting: Called with a sentence while they give none.

    Raises:
        UsageError: ``scheduler`` is not an address.
        NotFoundError: Dask is not installed, no scheduler answers, or it has no worker.
        StoreError: The cluster was lost, or gave no sign of life for too long, or a worker has another
            directory or other versions.
        Whatever ``task`` raises, for the first item that fails.
    """
    with _connected(scheduler) as client:
        here, pulse = surroundings(), Pulse(client, scheduler, patience, waiting)

        def results(positions: Iterable[int]) -> Iterator[tuple[int, Result | WorkerDied]]:
            submit = partial(client.submit, _in_same_surroundings, here, task, pure=False)
            running = {submit(items[position]): position for position in positions}
            finished: SimpleQueue[Any] = SimpleQueue()
            for future in running:
                future.add_done_callback(finished.put)
            while running:
                try:
                    future = finished.get(timeout=LOOK)
                except Empty:
                    pulse.feel()
                else:
                    pulse.felt = time.monotonic()
                    yield running.pop(future), _result(future, pulse)

        near_a_death = []
        for position, result in results(range(len(items))):
            if isinstance(result, WorkerDied):
                near_a_death.append(position)
            else:
                yield position, result
        for position in near_a_death:
            yield from results([position])


@dataclass
class Pulse:
    """The signs of life of a cluster: its scheduler answers, and a worker was heard of since the last look.

    The scheduler keeps connections open, and tasks waiting, when it is frozen or all workers are gone.
    """

    client: Any
    scheduler: str
    patience: float
    waiting: Callable[[str], None] | None
    felt: float = field(default_factory=time.monotonic)
    heard: float = 0.0  # when the scheduler last heard of any worker, by its own clock

    def feel(self) -> None:
        """Look for a sign of life.

        Raises:
            StoreError: There was none for longer than the patience.
        """
        missing = self._missing()
        now = time.monotonic()
        if not missing:
            self.felt = now
            return
        if self.waiting is not None:
            self.waiting(f"waiting, {missing}")
        if now - self.felt > self.patience:
            raise StoreError(
                f"the cluster gave no sign of life for {self.patience:g} s: {missing}.",
                hint="Run the same command again when it is back; what was finished is not made again. "
                "--patience S waits longer.",
            )

    def _missing(self) -> str:
        try:
            known = self.client.sync(self.client.scheduler.identity, callback_timeout=self.patience / LOOKS)
        except (OSError, *LATE):
            return f"the scheduler at {self.scheduler} does not answer"
        heard = max((worker["last_seen"] for worker in known["workers"].values()), default=None)
        if heard is None:
            return f"the scheduler at {self.scheduler} has no worker"
        before, self.heard = self.heard, heard
        return "" if heard > before else "none of its workers answers"


def surroundings() -> dict[str, str]:
    """Return what must be the same at every worker, for a result to be the same: names and values."""
    return {
        "skillctl": skillctl.__version__,
        **{name: _installed(name) for name in DECIDING},
        "the directory": os.getcwd(),  # noqa: PTH109  # its text is compared
        "SOURCE_DATE_EPOCH": os.environ.get("SOURCE_DATE_EPOCH", "not set"),
    }


def _installed(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _in_same_surroundings(here: dict[str, str], task: Callable[[Item], Result], item: Item) -> Result:
    """Run in a worker of the cluster."""
    there = surroundings()
    for name, expected in here.items():
        if there.get(name) != expected:
            raise StoreError(
                f"a worker of the cluster differs: {name} is {there.get(name)} there and {expected} here.",
                hint="Start `dask worker` in this directory, with the same packages and surroundings.",
            )
    with _one_at_a_time, one_blas_thread():
        return task(item)


def _result(future: Any, pulse: Pulse) -> Any:
    """Return what a task gave, which its worker keeps until it is asked for."""
    from distributed import KilledWorker

    try:
        while True:
            try:
                return future.result(timeout=pulse.patience / LOOKS)
            except LATE:
                if future.status == "error":  # it is what the task raised
                    raise
                pulse.feel()
    except KilledWorker:
        return WorkerDied()
    except ModuleNotFoundError as error:
        raise NotFoundError(
            f"a worker of the cluster lacks a package: {error}.",
            hint="Install the same version of skillctl for all workers.",
        ) from error
    except (CancelledError, asyncio.CancelledError) as error:
        raise StoreError(
            "the cluster was lost.",
            hint="Run the same command again when it is back; what was finished is not made again.",
        ) from error


@contextmanager
def _connected(scheduler: str) -> Iterator[Any]:
    """Yield a client of a scheduler that has workers."""
    if not ADDRESS.fullmatch(scheduler):
        raise UsageError(
            f"scheduler: {printable(scheduler)!r} is no address.", hint="It looks like tcp://127.0.0.1:8786."
        )
    try:
        from distributed import Client
    except ImportError as error:
        raise NotFoundError(
            "Dask is not installed; only --backend dask needs it.",
            hint="Install it: pip install distributed",
        ) from error
    with _silent(), _answering(Client, scheduler) as client:
        try:
            client.wait_for_workers(1, timeout=TIMEOUT)
        except LATE as error:
            raise NotFoundError(
                f"the scheduler at {scheduler} has no worker.",
                hint=f"Start some: dask worker {scheduler}",
            ) from error
        yield client


@contextmanager
def _silent() -> Iterator[None]:
    """Let Dask log nothing: our own messages say what is wrong.

    After an exception it stays silent, because what is left of a client goes on to log tracebacks.
    """
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    yield
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)


@contextmanager
def _answering(client_class: Any, scheduler: str) -> Iterator[Any]:
    try:
        client = client_class(scheduler, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, *LATE) as error:
        raise NotFoundError(
            f"no Dask scheduler answers at {scheduler}.",
            hint="`dask scheduler` starts one and prints its address, as in tcp://127.0.0.1:8786.",
        ) from error
    try:
        yield client
    finally:
        with suppress(*LATE):  # a scheduler that is frozen does not answer now, either
            client.close(timeout=LOOK)
