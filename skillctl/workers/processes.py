"""Work in other processes: one that dies costs its own item only, and Ctrl-C leaves none behind."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from queue import SimpleQueue

from skillctl.workers import Item, Result, WorkerDied
from skillctl.workers.child import Child, ChildDiedError


def run_in_processes(
    task: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Generator[tuple[int, Result | WorkerDied], None, None]:
    """Yield (position, task(item)) for every item, in the order in which they are done.

    An item whose process dies is run again after the others, alone: memory may have been short. Closing the
    generator, or an exception in it (Ctrl-C), ends all processes at once.

    Args:
        task: A function at the top level of a module, not of the program itself; the same item must give the
            same result in any process.
        items: Arguments of ``task``, picklable.
        jobs: How many processes.

    Raises:
        Whatever ``task`` raises, for the first item that fails.
    """
    idle: SimpleQueue[Child] = SimpleQueue()

    def run(position: int) -> Result | WorkerDied:
        child = idle.get()
        try:
            result: Result = child.call(task, items[position])
            return result
        except ChildDiedError:
            return WorkerDied()
        finally:
            idle.put(child)

    with ExitStack() as stack:
        threads = stack.enter_context(ThreadPoolExecutor(jobs))  # each waits for one process
        for _ in range(jobs):
            idle.put(stack.enter_context(Child()))
        stack.callback(threads.shutdown, wait=False, cancel_futures=True)  # before the children are ended
        running = {threads.submit(run, position): position for position in range(len(items))}
        died = []
        for future in as_completed(list(running)):
            position, result = running.pop(future), future.result()
            if isinstance(result, WorkerDied):
                died.append(position)
            else:
                yield position, result
        for position in died:
            yield position, run(position)
