"""Work on a Dask cluster, whose workers must have the same directory, files and versions as this process."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import skillctl
from skillctl.errors import NotFoundError, StoreError, UsageError, printable
from skillctl.workers import Item, Result, WorkerDied
from skillctl.workers.blas import one_blas_thread

TIMEOUT = 10.0  # [s], for a scheduler to answer, and for a first worker
ADDRESS = re.compile(r"([a-z]+://)?(\[[0-9a-f:]+\]|[^\s:/]+):\d{1,5}/?")
DECIDING = ("numpy", "scipy", "pybullet")  # their versions decide the last digits

_one_at_a_time = threading.Lock()  # threads of one worker share standard output


def run_on_cluster(
    task: Callable[[Item], Result], items: Sequence[Item], scheduler: str
) -> Generator[tuple[int, Result | WorkerDied], None, None]:
    """Yield (position, task(item)) for every item, in the order in which they are done.

    When a worker dies, the scheduler tries its items elsewhere, three times unless configured otherwise. Then
    it gives up all items of the last worker, whichever of them was the cause. These items are run again
    one at a time; an item whose worker dies then has caused it.

    Raises:
        UsageError: ``scheduler`` is not an address.
        NotFoundError: Dask is not installed, no scheduler answers, or it has no worker.
        StoreError: The cluster was lost, or a worker has another directory or other versions.
        Whatever ``task`` raises, for the first item that fails.
    """
    with _connected(scheduler) as client:
        here = surroundings()

        def results(positions: Iterable[int]) -> Iterator[tuple[int, Result | WorkerDied]]:
            from distributed import as_completed

            submit = partial(client.submit, _in_same_surroundings, here, task, pure=False)
            running = {submit(items[position]): position for position in positions}
            for future in as_completed(list(running), loop=client.loop):
                yield running.pop(future), _result(future)

        near_a_death = []
        for position, result in results(range(len(items))):
            if isinstance(result, WorkerDied):
                near_a_death.append(position)
            else:
                yield position, result
        for position in near_a_death:
            yield from results([position])


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
            hint="Install it: pip install distributed",
        ) from error
    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # our own messages say what is wrong
    try:
        with _answering(Client, scheduler) as client:
            try:
                client.wait_for_workers(1, timeout=TIMEOUT)
            except (TimeoutError, asyncio.TimeoutError) as error:
                raise NotFoundError(
                    f"the scheduler at {scheduler} has no worker.",
                    hint=f"Start some: dask worker {scheduler}",
                ) from error
            yield client
    finally:
        logger.setLevel(level)


def _answering(client_class: Any, scheduler: str) -> Any:
    try:
        return client_class(scheduler, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError, asyncio.TimeoutError) as error:
        raise NotFoundError(
            f"no Dask scheduler answers at {scheduler}.",
            hint="`dask scheduler` starts one and prints its address, as in tcp://127.0.0.1:8786.",
        ) from error
