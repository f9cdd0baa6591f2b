"""One thread for linear algebra in every worker: none fights for cores, and sums are the same everywhere."""

from __future__ import annotations

import os
from collections.abc import Callable

from skillctl.workers import Item, Result

# The matrices of a skill are tiny: more BLAS threads only cost time, and one thread gives every machine the
# same sums. The variables count only if they are set before NumPy is imported.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_by_environment() -> None:
    """Let libraries that are loaded from now on, here and in children, have one thread."""
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"


def with_one_thread(task: Callable[[Item], Result], item: Item) -> Result:
    """Return task(item), libraries that are loaded already having one thread meanwhile."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return task(item)
