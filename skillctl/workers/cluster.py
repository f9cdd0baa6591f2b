"""Work on a Dask cluster, whose workers must have the same directory, files and versions as this process."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from typing import Any

import skillctl
from skillctl.errors import NotFoundError, StoreError, UsageError, printable
from skillctl.workers import Item, Result, WorkerDied
from skillctl.workers.threads import one_in_what_is_loaded

AHEAD = 1000  # items on the cluster at once: more than it has workers, and no more than a scheduler likes
TIMEOUT = 10.0  # [s], for a scheduler to answer, and for a first worker
ADDRESS = re.compile(r"([a-z]+://)?(\[[0-9a-f:]+\]|[^\s:/]+):\d{1,5}/?")
DECIDING = ("numpy", "scipy", "pybullet")  # their versions decide the last digits

_one_at_a_time = threading.Lock()  # threads of one worker would share standard output and thread limits


def run_on_cluster(
    task: Callable[[Item], Result], items: Sequence[Item], scheduler: str
) -> Generator[tuple[int, Result | WorkerDied], None, None]:
    """Yield (position, task(item)) for every item, in the order in which they are done.

    The scheduler tries an item whose worker dies again elsewhere, three times unless configured otherwise;
    then it gives up all that the last worker had to do. Such items are run again one at a time: what dies
    there, too, has died by itself.

    Raises:
        UsageError: That is no address.
        NotFoundError: Dask is not installed, no scheduler answers, or it has no worker.
        StoreError: The cluster was lost, or a worker is not where we are.
        Whatever ``task`` raises, for the first item that is noticed.
    """
    with _connected(scheduler) as client:
        near_a_death: list[tuple[int, Item]] = []
        for numbered, result in _stream(client, task, enumerate(items)):
            if isinstance(result, WorkerDied):
                near_a_death.append(numbered)
            else:
                yield numbered[0], result
        for suspect in near_a_death:
            for (position, _), result in _stream(client, task, iter([suspect])):
                yield position, result


def _stream(
    client: Any, task: Callable[[Item], Result], waiting: Iterator[tuple[int, Item]]
) -> Iterator[tuple[tuple[int, Item], Result | WorkerDied]]:
    """Yield numbered items and their results; never more than a certain number is on the cluster."""
    from distributed import as_completed

    here = surroundings()
    running: dict[Any, tuple[int, Item]] = {}
    finished = as_completed(loop=client.loop)

    def submit(count: int) -> None:
        for numbered in islice(waiting, count):
            future = client.submit(_in_same_surroundings, here, task, numbered[1], pure=False)
            running[future] = numbered
            finished.add(future)

    submit(AHEAD)
    while running:
        future = next(finished)
        yield running.pop(future), _result(future)
        submit(1)


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
                f"a worker of the cluster works elsewhere: {name} is {there.get(name)} there and {expected} "
                "here.",
                hint="Start `dask worker` in this directory, with the same packages and surroundings.",
            )
    with _one_at_a_time, one_in_what_is_loaded():
        return task(item)


def _result(future: Any) -> Any:
    from distributed import KilledWorker

    try:
        return future.result()
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
            hint="In your clone of skillctl: pip install '.[cluster]'",
        ) from error
    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # our own messages say what is wrong
    try:
        with _client(Client, scheduler) as client:
            yield client
    finally:
        logger.setLevel(level)


def _client(client_class: Any, scheduler: str) -> Any:
    try:
        client = client_class(scheduler, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError, asyncio.TimeoutError) as error:
        raise NotFoundError(
            f"no Dask scheduler answers at {scheduler}.",
            hint="`dask scheduler` starts one and says its address, as in tcp://127.0.0.1:8786.",
        ) from error
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except BaseException as error:
        client.close()
        if not isinstance(error, asyncio.TimeoutError | TimeoutError):
            raise
        raise NotFoundError(
            f"the scheduler at {scheduler} has no worker.", hint=f"Start some: dask worker {scheduler}"
        ) from error
    return client
