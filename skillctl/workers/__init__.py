"""Work on many items in this process, in others, or on a cluster; the results are the same."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

from skillctl.errors import UsageError

Item = TypeVar("Item")
Result = TypeVar("Result")

Backend: TypeAlias = Literal["processes", "dask"]

PATIENCE = 60.0  # [s]


class WorkerDied:
    """The result of an item whose process crashed or was killed."""


@dataclass(frozen=True)
class Workers:
    """Where work is done.

    Attributes:
        jobs: Number of processes on this machine.
        scheduler: Address of a Dask scheduler, whose workers are used instead.
        patience: How long a cluster may give no sign of life, [s].
    """

    jobs: int = 1
    scheduler: str | None = None
    patience: float = PATIENCE

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise UsageError(f"jobs: must be at least 1, got {self.jobs}.")
        if not 0 < self.patience < math.inf:
            raise UsageError(f"patience: must be above 0 s, got {self.patience:g}.")

    @classmethod
    def chosen(
        cls, jobs: int | None, backend: Backend, scheduler: str | None, patience: float | None = None
    ) -> Workers:
        """Return the workers that the options select.

        Raises:
            UsageError: The options contradict each other.
        """
        if backend == "dask":
            if not scheduler:
                raise UsageError(
                    "--backend dask needs the address of a scheduler.",
                    hint="Add --scheduler tcp://HOST:8786; `dask scheduler` prints it when it starts.",
                )
            if jobs is not None:
                raise UsageError(
                    "--jobs counts processes of this machine, not the workers of a cluster.",
                    hint="Leave out --jobs.",
                )
            return cls(scheduler=scheduler, patience=PATIENCE if patience is None else patience)
        for option, given in (("scheduler", scheduler), ("patience", patience)):
            if given is not None:
                raise UsageError(f"--{option} is about a cluster.", hint="Add --backend dask.")
        return cls(1 if jobs is None else jobs)

    def run(
        self,
        task: Callable[[Item], Result],
        items: Sequence[Item],
        *,
        done: Callable[[int, Result | WorkerDied], None] | None = None,
        waiting: Callable[[str], None] | None = None,
        isolated: bool = False,
    ) -> list[Result | WorkerDied]:
        """Return task(item) for every item, in their order. A process that dies costs its own item only.

        Args:
            task: Picklable; the same item must give the same result in any process. It has one thread for
                linear algebra.
            items: Arguments of ``task``, picklable.
            done: Called with (position, result) as soon as each is known, in any order.
            waiting: Called with a sentence while a cluster gives no sign of life.
            isolated: Use processes of their own even for one job, because the task may crash.

        Raises:
            NotFoundError: There is no such cluster, or Dask is not installed.
            StoreError: The cluster was lost, or gave no sign of life for too long, or its workers
                have another directory or other versions.
            Whatever ``task`` raises, for the first item that fails.
        """
        results: dict[int, Result | WorkerDied] = {}
        with closing(self._stream(task, items, isolated, waiting)) as stream:  # an exception ends all of it
            for position, result in stream:
                results[position] = result
                if done is not None:
                    done(position, result)
        return [results[position] for position in range(len(items))]

    def _stream(
        self,
        task: Callable[[Item], Result],
        items: Sequence[Item],
        isolated: bool,
        waiting: Callable[[str], None] | None,
    ) -> Generator[tuple[int, Result | WorkerDied], None, None]:
        if self.scheduler is not None:
            from skillctl.workers.cluster import run_on_cluster

            return run_on_cluster(task, items, self.scheduler, self.patience, waiting)
        if self.jobs > 1 or isolated:
            from skillctl.workers.processes import run_in_processes  # late: most commands run one thing

            return run_in_processes(task, items, min(self.jobs, max(len(items), 1)))
        return ((position, task(item)) for position, item in enumerate(items))
