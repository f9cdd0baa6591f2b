"""Work in other processes: one that dies costs its own item only, and Ctrl-C leaves none behind."""

from __future__ import annotations

import select
from collections import deque
from collections.abc import Callable, Collection, Generator, Sequence
from contextlib import ExitStack

from skillctl.memory import WORKERS
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
    with ExitStack() as stack:
        idle = [stack.enter_context(Child(environment={WORKERS: str(jobs)})) for _ in range(jobs)]
        running: dict[Child, int] = {}
        waiting, died, done = deque(range(len(items))), list[int](), list[tuple[int, Result]]()
        while waiting or running or done:
            while waiting and idle:
                position, child = waiting.popleft(), idle.pop()
                try:
                    child.ask(task, items[position])
                    running[child] = position
                except ChildDiedError:
                    died.append(position)
                    idle.append(child)
            yield from done  # now that there is other work to do meanwhile
            done.clear()
            for child in _answering(running):
                position = running.pop(child)
                idle.append(child)
                try:
                    done.append((position, child.answer()))
                except ChildDiedError:
                    died.append(position)
        for position in died:
            yield position, _alone(task, items[position], idle[0])


def _answering(children: Collection[Child]) -> list[Child]:
    """Wait until one of the children has answered, or died, and return all that have."""
    if not children:
        return []
    poll, of = select.poll(), {child.fileno(): child for child in children}
    for descriptor in of:
        poll.register(descriptor, select.POLLIN)
    return [of[descriptor] for descriptor, _ in poll.poll()]


def _alone(task: Callable[[Item], Result], item: Item, child: Child) -> Result | WorkerDied:
    try:
        result: Result = child.call(task, item)
    except ChildDiedError:
        return WorkerDied()
    return result
