"""What only shows between processes: same bytes anywhere, publishing at once, being killed, memory."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skillctl import store

MAKE = Path(__file__).parents[1] / "archives" / "v2" / "make.py"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def python(code: str, *arguments: object, **options) -> subprocess.Popen:
    options["env"] = {**os.environ, **ONE_THREAD, **options.get("env", {})}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


# Determinism


def test_the_same_content_gives_the_same_bytes_in_any_process(tmp_path):
    surroundings = [
        {},
        {"PYTHONHASHSEED": "1", "TZ": "Asia/Kathmandu", "LC_ALL": "C", "HDF5_USE_FILE_LOCKING": "FALSE"},
        {
            "PYTHONHASHSEED": "2",
            "TZ": "America/St_Johns",
            "LC_ALL": "C.UTF-8",
            "HDF5_PLUGIN_PATH": "/nowhere",
            "OMP_NUM_THREADS": "2",
            "OPENBLAS_NUM_THREADS": "2",
        },
    ]
    outputs = set()
    for index, environment in enumerate(surroundings):
        (directory := tmp_path / str(index)).mkdir(mode=0o700)
        run = subprocess.run(
            [sys.executable, MAKE, directory],
            env={**os.environ, **ONE_THREAD, **environment},
            cwd=directory, umask=0o077 * index, capture_output=True, text=True, check=True,
        )  # fmt: skip
        outputs.add(run.stdout)
        time.sleep(0.01)  # another moment
    assert len(outputs) == 1
    made = [line.split() for line in outputs.pop().splitlines()]
    pinned = json.loads(MAKE.with_name("digests.json").read_text())
    assert len(made) >= 10
    assert all(pinned[name] == digest for digest, _, name in made)


# Publishing at once

WRITER = """
import sys
from dataclasses import replace
from pathlib import Path
from skillctl import store
root, template, writer, count = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
base = store.read_skill(template)
for index in range(count):
    operation = store.Operation(command="learn", results={"writer": writer, "index": index})
    data = store.encode(replace(base, operation=operation))
    published = store.Registry(root).publish("reach", data)
    print(published.version, published.digest, flush=True)
"""


@pytest.fixture
def template(tmp_path, wrap, make_seds):
    path = tmp_path / "template.h5"
    store.write_file(path, store.encode(wrap(make_seds(1))))
    return path


def reported(output: str) -> dict[int, str]:
    """Return digest by version of what a writer said it had published."""
    return {int(number): digest for number, digest in re.findall(r"^(\d+) (sha256:\w{64})$", output, re.M)}


def test_eight_writers_at_once_get_unique_numbers_without_gaps(tmp_path, template):
    root, each = tmp_path / "skills", 6
    writers = [python(WRITER, root, template, n, each) for n in range(8)]
    outputs = [writer.communicate(timeout=120) for writer in writers]
    assert [errors for _, errors in outputs] == [""] * 8

    published: dict[int, str] = {}
    for output, _ in outputs:
        mine = reported(output)
        assert len(mine) == each
        assert not published.keys() & mine.keys()
        published |= mine
    registry = store.Registry(root)
    assert sorted(published) == list(range(1, 8 * each + 1)) == list(registry.versions("reach"))
    for number, digest in published.items():
        assert store.read_skill(registry.path_of("reach", number)).digest == digest
    assert len(list((root / "reach").iterdir())) == 8 * each


def test_writers_of_one_content_make_one_version(tmp_path, template):
    root = tmp_path / "skills"
    code = (
        "import sys; from pathlib import Path; from skillctl import store; sys.stdin.read(1)\n"
        "print(store.Registry(Path(sys.argv[1])).publish('reach', Path(sys.argv[2]).read_bytes()).created)"
    )
    writers = [python(code, root, template, stdin=subprocess.PIPE) for _ in range(4)]
    outputs = [writer.communicate("x", timeout=60) for writer in writers]
    assert sorted(output for output, _ in outputs) == ["False\n"] * 3 + ["True\n"]
    assert list((root / "reach").iterdir()) == [root / "reach" / "1.h5"]


def test_a_killed_writer_loses_nothing_it_reported_and_leaves_nothing_half(tmp_path, template):
    root, rng = tmp_path / "skills", random.Random(0)
    registry = store.Registry(root)
    published: dict[int, str] = {}
    for round_number in range(6):
        writer = python(WRITER, root, template, round_number, 100_000)
        first = writer.stdout.readline()
        time.sleep(rng.uniform(0, 0.1))
        os.kill(writer.pid, signal.SIGKILL)
        output, _ = writer.communicate(timeout=60)
        published |= reported(first + output)

    numbers = registry.versions("reach")
    assert numbers == tuple(range(1, len(numbers) + 1))
    assert published.keys() <= set(numbers)
    assert len(numbers) - len(published) <= 6  # each was killed at most once between link and report
    for number in numbers:
        digest = store.read_skill(registry.path_of("reach", number)).digest
        assert published.get(number, digest) == digest
    assert len(list((root / "reach").iterdir())) == len(numbers)


# Memory


def test_a_hostile_file_costs_little_memory(tmp_path, hostile):
    """An array claimed to be terabytes large: refused in an address space where it could not be allocated."""
    from h5py import h5d, h5s, h5t

    def edit(body):
        del body["demonstrations/positions"]
        space = h5s.create_simple((2**39, 2))
        h5d.create(body.id, b"demonstrations/positions", h5t.IEEE_F64LE, space)

    (path := tmp_path / "huge.h5").write_bytes(hostile(edit))
    code = (
        "import resource, sys; from skillctl import store; store.decode\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: store.read_skill(sys.argv[1])\n"
        "except Exception as error: print(error)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    output, _ = python(code, path).communicate(timeout=60)
    message, grown = output.splitlines()
    assert "N = 549755813888 is not within" in message
    assert int(grown) < 50_000  # [KiB]
