"""One thread for linear algebra in every worker: they do not compete for cores, and sums are the same."""

from __future__ import annotations

import os

# The matrices of a skill are tiny: more BLAS threads only cost time, and one thread gives every machine the
# same sums. The variables count only if they are set before NumPy is imported.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_by_environment() -> None:
    """Let libraries that are loaded from now on, here and in children, have one thread."""
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"
