"""Work in processes of their own: one that dies costs its own item only, and Ctrl-C leaves none behind."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from skillctl.workers import Item, Result, WorkerDied
from skillctl.workers.threads import one_by_environment, one_in_what_is_loaded


def run_in_processes(
    task: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Generator[tuple[int, Result | WorkerDied], None, None]:
    """Yield (position, task(item)) for every item, in the order in which they are done.

    A dying process takes its pool with it. Whatever was running then is run again, one item in a process
    of its own at a time: what dies there, too, has died by itself. Closing the generator, or an exception
    in it (Ctrl-C), ends all processes at once.

    Args:
        task: Picklable; the same item must give the same result in any process.
        items: What to call it with.
        jobs: How many processes. They start by importing the program that runs: a script that calls this
            needs ``if __name__ == "__main__":``.

    Raises:
        Whatever ``task`` raises, for the first item that is noticed.
    """
    waiting = deque(enumerate(items))
    while waiting:
        for numbered in (yield from _run_until_a_death(task, waiting, jobs)):
            if (yield from _run_until_a_death(task, deque([numbered]), 1)):
                yield numbered[0], WorkerDied()


def _run_until_a_death(
    task: Callable[[Item], Result], waiting: deque[tuple[int, Item]], jobs: int
) -> Generator[tuple[int, Result | WorkerDied], None, list[tuple[int, Item]]]:
    """Consume ``waiting`` and yield results; return what was running when a process died."""
    with _pool(jobs) as executor:
        running: dict[Future[Result], tuple[int, Item]] = {}
        while waiting or running:
            try:
                while waiting and len(running) < jobs:
                    future = _submit(executor, task, waiting[0][1])
                    running[future] = waiting.popleft()
            except BrokenProcessPool:  # died idle, or we notice it here first
                return list(running.values())
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                if isinstance(future.exception(), BrokenProcessPool):
                    return list(running.values())
                yield running.pop(future)[0], future.result()
    return []


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Return a pool whose processes are ended, not waited for, when the block is left by an exception."""
    others = set(multiprocessing.active_children())
    # Forked processes would share Bullet's and BLAS's state with ours; spawned ones begin anew.
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
    try:
        yield executor
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _submit(executor: ProcessPoolExecutor, task: Callable[[Any], Result], item: Any) -> Future[Result]:
    """Submit with Ctrl-C held back: a process started now inherits that, and it is ours to answer it."""
    if not hasattr(signal, "pthread_sigmask"):
        return executor.submit(task, item)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return executor.submit(task, item)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """Make a new process a worker: one thread for linear algebra, and no orphan if its parent is killed."""
    one_by_environment()
    one_in_what_is_loaded()  # by the program that runs, which a new process imports first
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(process: BaseProcess) -> None:
    process.join()
    os._exit(1)
