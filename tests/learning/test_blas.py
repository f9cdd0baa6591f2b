"""One BLAS thread while learning, whoever else learns at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.workers.blas import one_blas_thread

pytestmark = pytest.mark.usefixtures("two_threads")


@pytest.fixture
def two_threads() -> Iterator[None]:
    import scipy.linalg  # noqa: F401  # which brings a BLAS of its own

    with threadpool_limits(2, user_api="blas"):
        yield


def limits() -> set[int]:
    """Threads of all BLAS libraries that can have several; some test tools bring one that cannot."""
    blas = [library for library in threadpool_info() if library["user_api"] == "blas"]
    return {library["num_threads"] for library in blas if library.get("threading_layer") != "disabled"}


def test_the_limit_holds_until_the_last_holder_leaves() -> None:
    assert limits() == {2}
    with one_blas_thread():
        with one_blas_thread():
            assert limits() == {1}
        assert limits() == {1}
    assert limits() == {2}


def test_the_limit_is_lifted_after_an_error() -> None:
    with pytest.raises(RuntimeError), one_blas_thread():
        raise RuntimeError
    assert limits() == {2}


def test_the_limit_is_lifted_whatever_another_thread_limited_meanwhile() -> None:
    limited, leave = threading.Event(), threading.Event()

    def interfere() -> None:
        with threadpool_limits(1, user_api="blas"):
            limited.set()
            assert leave.wait(timeout=30)

    with ThreadPoolExecutor(1) as pool:
        with one_blas_thread():
            with one_blas_thread():
                pass
            other = pool.submit(interfere)
            assert limited.wait(timeout=30)
        assert limits() == {2}
        leave.set()
        other.result(timeout=30)


@pytest.mark.parametrize("first_to_leave", [0, 1])
def test_holders_in_two_threads_share_the_limit(first_to_leave: int) -> None:
    inside = threading.Barrier(3, timeout=30)
    leave = [threading.Event(), threading.Event()]

    def hold(index: int) -> None:
        with one_blas_thread():
            inside.wait()
            assert leave[index].wait(timeout=30)

    with ThreadPoolExecutor(2) as pool:
        holders = [pool.submit(hold, index) for index in range(2)]
        inside.wait()
        for index in (first_to_leave, 1 - first_to_leave):
            assert limits() == {1}
            leave[index].set()
            holders[index].result(timeout=30)
        assert limits() == {2}


def test_learning_in_two_threads_gives_the_same_bytes_and_leaves_the_limits_as_they_were(
    curved: Callable[..., DemonstrationSet],
) -> None:
    shown = curved(dimension=3)
    options = LearnOptions(preset="fast", n_components=4)

    def learned(_: int) -> tuple[bytes, ...]:
        skill = fit(shown, options).skill
        return tuple(
            a.tobytes() for a in (skill.priors, skill.means, skill.covariances, skill.system_matrices)
        )

    alone = learned(0)
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(learned, range(4))) == [alone] * 4
    assert limits() == {2}
