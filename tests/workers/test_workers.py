"""Who does the work: whichever it is, every item is done once, and the results come in order."""

from __future__ import annotations

import os

import pytest

from skillctl.errors import InputDataError, UsageError
from skillctl.workers import Workers
from skillctl.workers.cluster import run_on_cluster, surroundings


@pytest.mark.parametrize(
    ("workers", "isolated", "in_this_process"),
    [(Workers(), False, True), (Workers(), True, False), (Workers(jobs=2), False, False)],
)
def test_results_stand_in_the_order_of_the_items(workers: Workers, isolated: bool, in_this_process) -> None:
    done: dict[int, object] = {}
    results = workers.run(str.upper, ["b", "c", "a"], done=done.__setitem__, isolated=isolated)
    assert results == ["B", "C", "A"]
    assert done == {0: "B", 1: "C", 2: "A"}
    (process,) = workers.run(_process_of, [None], isolated=isolated)
    assert (process == os.getpid()) == in_this_process


def _process_of(_: None) -> int:
    return os.getpid()


def test_no_items_are_no_work() -> None:
    assert Workers(jobs=3).run(str.upper, []) == []


@pytest.mark.parametrize("workers", [Workers(), Workers(jobs=2)])
def test_what_a_task_raises_ends_the_work(workers: Workers) -> None:
    with pytest.raises(InputDataError, match="odd") as caught:
        workers.run(_refuse, ["odd"])
    assert caught.value.hint == "Even it out."


def _refuse(item: str) -> None:
    raise InputDataError(item, hint="Even it out.")


@pytest.mark.parametrize(
    ("options", "workers"),
    [
        ((None, "processes", None), Workers(1)),
        ((4, "processes", None), Workers(4)),
        ((None, "dask", "tcp://a:1"), Workers(scheduler="tcp://a:1")),
        ((None, "dask", "tcp://a:1", 5.0), Workers(scheduler="tcp://a:1", patience=5.0)),
    ],
)
def test_options_name_the_workers(options, workers: Workers) -> None:
    assert Workers.chosen(*options) == workers


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((0, "processes", None), "jobs: must be at least 1, got 0"),
        ((None, "dask", None), "--backend dask needs the address of a scheduler"),
        ((2, "dask", "tcp://a:1"), "--jobs counts processes of this machine"),
        ((None, "processes", "tcp://a:1"), "--scheduler is about a cluster"),
        ((None, "processes", None, 5.0), "--patience is about a cluster"),
        ((None, "dask", "tcp://a:1", 0.0), "patience: must be above 0 s, got 0"),
        ((None, "dask", "tcp://a:1", float("nan")), "patience: must be above 0 s"),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Workers.chosen(*options)


@pytest.mark.parametrize("address", ["", "tcp://", "a b:1", "host", "host:123456", "tcp://host:1/x"])
def test_what_is_no_address_of_a_scheduler_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="is no address"):
        list(run_on_cluster(str.upper, ["a"], address, 1.0))


def test_surroundings_name_what_decides_a_result(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    here = surroundings()
    assert here["the directory"] == str(tmp_path)
    assert here["SOURCE_DATE_EPOCH"] == "not set"
    assert set(here) >= {"skillctl", "numpy", "scipy"}
