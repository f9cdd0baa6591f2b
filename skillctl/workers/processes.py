"""Work in processes of their own: one that dies costs its own item only, and Ctrl-C leaves none behind."""

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

    An item whose process dies is run again after the others, alone: memory may have been short, or somebody
    killed the process. What dies then, too, has died by itself. Closing the generator, or an exception in it
    (Ctrl-C), ends all processes at once.

    Args:
        task: A function at the top level of a module, not of the program itself; the same item must give the
            same result in any process.
        items: What to call it with, picklable.
        jobs: How many processes.

    Raises:
        Whatever ``task`` raises, for the first item that is noticed.
    """
    with ExitStack() as stack:
        threads = stack.enter_context(ThreadPoolExecutor(jobs))  # one waits for each process
        idle: SimpleQueue[Child] = SimpleQueue()
        for _ in range(jobs):
            idle.put(stack.enter_context(Child()))
        stack.callback(threads.shutdown, wait=False, cancel_futures=True)  # before the children are ended
        positions = {threads.submit(_run, idle, task, item): position for position, item in enumerate(items)}
        died = []
        for future in as_completed(list(positions)):
            position, result = positions.pop(future), future.result()
            if isinstance(result, WorkerDied):
                died.append(position)
            else:
                yield position, result
        for position in died:
            yield position, _run(idle, task, items[position])


def _run(idle: SimpleQueue[Child], task: Callable[[Item], Result], item: Item) -> Result | WorkerDied:
    """Return task(item), computed by a child that has nothing else to do."""
    child = idle.get()
    try:
        result: Result = child.call(task, item)
        return result
    except ChildDiedError:
        return WorkerDied()
    finally:
        idle.put(child)
