"""Many skills at once: whoever does the work, the bytes, the verdicts and the episodes are the same."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from skillctl.demonstrations.options import Reading
from skillctl.errors import InputDataError, NotFoundError, StoreError, UsageError
from skillctl.learning.options import LearnOptions
from skillctl.usecases import manifest
from skillctl.usecases.learn import learn
from skillctl.usecases.learn_many import learn_many
from skillctl.usecases.manifest import read_manifest
from skillctl.usecases.verify_stability import verify_stability
from skillctl.workers import WorkerDied, Workers

HAS_PYBULLET = importlib.util.find_spec("pybullet") is not None
FAST = "[options]\npreset = 'fast'\ncomponents = 2\n"
MANIFEST = f"""{FAST}
[[skills]]
name = "curve"
data = "curve-*.csv"

[[skills]]
name = "lost"
data = "nowhere-*.csv"

[[skills]]
output = "hook.h5"
data = ["hook-0.csv", "hook-1.csv"]
demos = "0-1"
metric = "euclidean"
message = "two of them"

[[skills]]
name = "broken"
data = ["broken.csv"]
"""


@pytest.fixture
def project(tmp_path: Path, curve_files, hook_files, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A manifest of two good skills and two bad ones, and a store, in the working directory."""
    for file in (*curve_files, *hook_files):
        shutil.copy(file, tmp_path)
    (tmp_path / "broken.csv").write_text("t,x,y\n0,0,0\n1,abc,0\n")
    (tmp_path / "many.toml").write_text(MANIFEST)
    (tmp_path / "skills").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(folder: Path) -> dict[str, bytes]:
    """Return the skills below a directory and their bytes, and take them away."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*.h5"))}
    shutil.rmtree(folder / "skills")
    (folder / "skills").mkdir()
    (folder / "hook.h5").unlink()
    return found


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of a Dask scheduler with two workers, processes that start in the working directory."""
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=":0",
        local_directory=str(tmp_path / "dask"),
    ) as local:
        yield local.scheduler_address


def test_a_batch_writes_what_learn_writes_and_goes_on_after_bad_ones(project: Path) -> None:
    report = learn_many("many.toml")
    assert [(each.skill, each.outcome) for each in report.skills] == [
        ("curve", "learned"),
        ("lost", "failed"),
        ("hook.h5", "learned"),
        ("broken", "failed"),
    ]
    assert (report.learned, report.up_to_date, report.failed) == (2, 0, 2)
    batch = made(project)
    options = LearnOptions(preset="fast", n_components=2)
    learn([f"curve-{i}.csv" for i in range(4)], name="curve", options=options)
    learn(
        ["hook-0.csv", "hook-1.csv"],
        output="hook.h5",
        note="two of them",
        options=LearnOptions(preset="fast", n_components=2, metric="euclidean"),
        reading=read_manifest(Path("many.toml"))[2].reading,
    )
    assert made(project) == batch


def test_two_processes_write_the_same_bytes_and_find_them_up_to_date(project: Path) -> None:
    alone = learn_many("many.toml")
    bytes_alone = made(project)
    together = learn_many("many.toml", workers=Workers(2))
    assert [each.report for each in together.skills] == [each.report for each in alone.skills]
    assert [str(each.error) for each in together.skills] == [str(each.error) for each in alone.skills]
    again = learn_many("many.toml", workers=Workers(2))
    assert [each.outcome for each in again.skills] == ["up to date", "failed"] * 2
    assert made(project) == bytes_alone


def test_a_cluster_gives_the_same_skills_verdicts_and_episodes(
    project: Path, cluster: str, run, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn_many("many.toml")
    alone = made(project)
    dask = ("--backend", "dask", "--scheduler", cluster)
    result = run("learn", "--batch", "many.toml", *dask)
    assert (result.exit_code, result.stderr.count("error: ")) == (5, 2)
    assert {str(p.relative_to(project)): p.read_bytes() for p in project.rglob("*.h5")} == alone

    (project / "skills").rename(project / "shop")
    monkeypatch.setenv("SKILLCTL_STORE", "shop")  # the workers know nothing of it
    files = ["hook.h5", "curve", "nowhere.h5"]
    here, there = run("verify-stability", *files, "--json"), run("verify-stability", *files, *dask, "--json")
    assert (here.exit_code, here.stdout) == (there.exit_code, there.stdout)
    assert [each["outcome"] for each in json.loads(there.stdout)["skills"]] == [
        "proved",
        "proved",
        "unreadable",
    ]
    if HAS_PYBULLET:
        episodes = ("simulate", "hook.h5", "--episodes", 3, "--max-duration", 0.1, "--hand", "free")
        placed = ("--plane", "yz", "--origin", "0.5,0,0.5")
        run(*episodes, *placed, "--table", "here.csv")
        assert run(*episodes, *placed, *dask, "--table", "there.csv").exit_code == 1  # too short to arrive
        assert Path("here.csv").read_bytes() == Path("there.csv").read_bytes()
        assert len(Path("here.csv").read_text().splitlines()) == 4


TASKS = """
import os, sys
def dies_at_three(item):
    if item == 3:
        os._exit(1)
    return item * item
def threads(item):
    import numpy
    from threadpoolctl import threadpool_info
    return sorted({pool["num_threads"] for pool in threadpool_info()})
"""


@pytest.fixture
def tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "scale_tasks.py").write_text(TASKS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    yield importlib.import_module("scale_tasks")
    del sys.modules["scale_tasks"]


def test_on_a_cluster_a_crash_costs_its_own_item_only(tasks, cluster: str) -> None:
    results = Workers(scheduler=cluster).run(tasks.dies_at_three, range(6))
    assert isinstance(results.pop(3), WorkerDied)
    assert results == [0, 1, 4, 16, 25]


def test_workers_of_a_cluster_in_another_directory_are_refused(
    tasks, cluster: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Relative paths would mean something else there."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(StoreError, match=r"the directory is .* there and .*elsewhere here"):
        Workers(scheduler=cluster).run(tasks.threads, [0])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1")
    with pytest.raises(StoreError, match="SOURCE_DATE_EPOCH is not set there and 1 here"):
        Workers(scheduler=cluster).run(tasks.threads, [0])


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_worker_has_one_thread_for_linear_algebra(
    tasks, jobs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(variable, "2")
    assert Workers(jobs).run(tasks.threads, [0, 1], isolated=True) == [[1], [1]]


def test_without_dask_its_extra_is_named(run, library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = run(
        *("verify-stability", "curve", "--store", library),
        *("--backend", "dask", "--scheduler", "tcp://127.0.0.1:1"),
    )
    assert result.exit_code == 4
    assert "pip install distributed" in result.stderr


def test_a_scheduler_that_does_not_answer_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    from skillctl.workers import cluster

    monkeypatch.setattr(cluster, "TIMEOUT", 0.2)
    with pytest.raises(NotFoundError, match="no Dask scheduler answers"):
        Workers(scheduler="tcp://127.0.0.1:9").run(abs, [1])


def test_a_dead_worker_costs_its_skill_only(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def with_a_death(self, task, items, *, done=None, waiting=None, isolated=False):
        results = [WorkerDied(), *map(task, items[1:])]
        for position in reversed(range(len(results))):
            done(position, results[position])
        return results

    monkeypatch.setattr(Workers, "run", with_a_death)
    report = learn_many("many.toml")
    assert [each.outcome for each in report.skills] == ["failed", "failed", "learned", "failed"]
    assert isinstance(report.skills[0].error, StoreError)
    verified = verify_stability(["hook.h5", "hook.h5"])
    assert [each.outcome for each in verified.skills] == ["unreadable", "proved"]


def test_verdicts_keep_the_order_of_the_inputs(library: Path) -> None:
    names = ["plain", "nowhere", "curve", "hook", "curve"]
    alone = verify_stability(names, store=library)
    together = verify_stability(names, store=library, workers=Workers(3))
    assert [each.skill for each in together.skills] == ["plain@1", "nowhere", "curve@1", "hook@1", "curve@1"]
    assert [each.certificate for each in together.skills] == [each.certificate for each in alone.skills]


def test_progress_counts_every_skill_once(project: Path) -> None:
    told: list[tuple[int, int]] = []
    learn_many("many.toml", progress=lambda stage, done, total: told.append((done, total)))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]  # the one without files has failed before the start


def test_the_worst_failure_decides_the_exit_code_and_all_are_told(run, project: Path) -> None:
    result = run("learn", "--batch", "many.toml")
    assert result.exit_code == 5
    assert [line for line in result.stderr.splitlines() if line.startswith("error: ")] == [
        "error: lost: many.toml: data: no file matches 'nowhere-*.csv'.",
        "error: broken: broken.csv, line 3, column 'x': 'abc' is not a number.",
    ]
    assert [line.split()[:2] for line in result.stdout.splitlines()[1:]] == [
        ["curve@1", "learned"],
        ["lost", "failed"],
        ["hook.h5", "learned"],
        ["broken", "failed"],
    ]
    (project / "many.toml").write_text(f"{FAST}[[skills]]\nname = 'curve'\ndata = 'curve-*.csv'\n")
    assert run("learn", "--batch", "many.toml").exit_code == 0


def test_files_are_relative_to_the_manifest(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (project / "inner").mkdir()
    monkeypatch.chdir(project / "inner")
    report = learn_many("../many.toml", store="../skills")
    assert [each.outcome for each in report.skills] == ["learned", "failed"] * 2
    assert (project / "hook.h5").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("skills = 3", "skills: must be a list of tables [[skills]], got 3."),
        ("skills = []", "skills: must be a list of tables [[skills]], got []."),
        ("[skills", "is not TOML"),
        ("", "skills: is missing."),
        ("options = 3\n[[skills]]\nname='a'\ndata='x'", "options: must be a table [options], got 3."),
        ("[options]\nname = 'a'\n[[skills]]\ndata='x'", "options: name: must be given in [[skills]]"),
        ("[[skills]]\nname='a'", "skill 1: data: is missing."),
        ("[[skills]]\nname='a'\ndata=[]", "skill 1: data: must not be empty, got []."),
        ("[[skills]]\nname='a'\ndata=['x', 3]", "skill 1: data: number 2 must be a text, got 3."),
        ("[[skills]]\ndata='x'", "skill 1: must have a name for the store, or an output file"),
        ("[[skills]]\ndata='x'\nname='a'\noutput='b.h5'", "skill 1: must have a name for the store"),
        (
            "[[skills]]\ndata='x'\nname='a'\nunits='inch'",
            "skill 1: units: must be 'mm', 'cm', 'm', 'deg' or 'rad', got 'inch'.",
        ),
        (
            "[[skills]]\ndata='x'\nname='a'\nslowest-rate=3",
            "skill 1: slowest rate: must be above 0 and at most 1",
        ),
        ("[[skills]]\ndata='x'\nname='a'\nslowest_rate=0.1", "Did you mean slowest-rate?"),
        ("[[skills]]\ndata='x'\nname='a'\ndemos='3-1'", "skill 1: demos: '3-1' is not a list of numbers"),
        ("[[skills]]\ndata='x'\nname='a'\nvalidate=1", "skill 1: validate: must be true or false, got 1."),
        ("[[skills]]\ndata='x'\nname='a'\nseed=1.5", "skill 1: seed: must be a whole number, got 1.5."),
        ("[[skills]]\ndata='x'\nname='a'\ncomponents=true", "components: must be a whole number or 'auto'"),
        (
            "[[skills]]\ndata='x'\noutput='a.h5'\n[[skills]]\ndata='y'\noutput='./a.h5'",
            "output: 'a.h5' is given to 2 skills",
        ),
    ],
)
def test_a_manifest_that_means_nothing_is_refused_before_anything_is_learned(
    tmp_path: Path, text: str, sentence: str
) -> None:
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(InputDataError) as refusal:
        read_manifest(tmp_path / "bad.toml")
    assert str(refusal.value).startswith(f"{tmp_path / 'bad.toml'}: ")
    assert sentence in str(refusal.value)
    assert refusal.value.hint


def test_a_manifest_knows_the_options_of_learn_and_their_defaults(tmp_path: Path) -> None:
    """What a command takes and a manifest does not is about one run, and not about one skill."""
    from skillctl.cli.app import load_command
    from skillctl.cli.learn import FOR_ALL

    per_run = {"depfile", "if-changed"}  # a build tool's, about one target
    options = {
        parameter.opts[0].removeprefix("--"): parameter
        for parameter in load_command("learn").params
        if parameter.expose_value and parameter.opts[0].startswith("--") and parameter.name not in FOR_ALL
    }
    keys = {field.alias or name for name, field in manifest.Skill.model_fields.items()}
    assert set(options) - per_run == keys - {"data"}
    (file := tmp_path / "m.toml").write_text("[[skills]]\ndata = 'x'\nname = 'a'\n")
    (entry,) = read_manifest(file)
    assert (entry.learning, entry.reading) == (LearnOptions(), Reading())


def test_ctrl_c_leaves_no_process_and_no_half_file(project: Path) -> None:
    """What was finished before is kept; the next run goes on from there."""
    entries = "".join(f"[[skills]]\noutput = 's{i}.h5'\ndata = 'curve-*.csv'\n" for i in range(40))
    (project / "long.toml").write_text(f"[options]\npreset = 'quality'\n{entries}")
    command = [sys.executable, "-m", "skillctl", "learn", "--batch", "long.toml", "--jobs", "2"]
    batch = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while not list(project.glob("s*.h5")):
        assert batch.poll() is None
        time.sleep(0.02)
    os.killpg(batch.pid, signal.SIGINT)
    told, complaints = batch.communicate(timeout=60)  # ends only when all who hold its pipes have ended
    assert (batch.returncode, told) == (130, "")
    assert complaints.startswith("error: interrupted")
    assert "Traceback" not in complaints
    finished = sorted(project.glob("s*.h5"))
    assert 0 < len(finished) < 40
    assert not [path for path in project.iterdir() if path.name.startswith(".")]
    assert {each.outcome for each in verify_stability(finished).skills} == {"proved"}


def test_workers_that_contradict_themselves_are_refused() -> None:
    for jobs, backend, scheduler in (
        (0, "processes", None),
        (2, "dask", "tcp://a:1"),
        (None, "dask", None),
        (None, "processes", "tcp://a:1"),
    ):
        with pytest.raises(UsageError):
            Workers.chosen(jobs, backend, scheduler)
