"""What only shows between processes: same bytes anywhere, publishing at once, being killed, fuzz."""

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

MAKE = Path(__file__).parents[1] / "archives" / "v1" / "make.py"
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
    assert len(outputs.pop().splitlines()) == 3


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


# Fuzz

FUZZ = """
import collections, hashlib, json, random, resource, sys
from pathlib import Path
from skillctl import store
from skillctl.errors import ArtifactError

resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
good = Path(sys.argv[1]).read_bytes()
digest, rng, counts = store.decode(good).digest, random.Random(sys.argv[2]), collections.Counter()

def seal(body):
    line = f"1 {len(body)} {hashlib.sha256(body).hexdigest()}\\ncombined {digest}\\n".encode()
    return (b"\\x89SKILL\\r\\n\\x1a\\n" + line).ljust(512, b"\\0") + body

def mutated(data):
    data, kind = bytearray(data), rng.choice(["bit", "byte", "word", "zero", "swap", "cut", "extend", "copy"])
    for _ in range(rng.randint(1, 6)):
        i, j, n = rng.randrange(len(data)), rng.randrange(len(data)), rng.choice([1, 2, 4, 8, 64, 512])
        i, j = min(i, len(data) - n), min(j, len(data) - n)
        if kind == "bit": data[i] ^= 1 << rng.randrange(8)
        elif kind == "byte": data[i] = rng.choice([0, 1, 2, 127, 128, 255])
        elif kind == "word": data[i : i + 8] = rng.choice([b"\\xff" * 8, (j).to_bytes(8, "little")])
        elif kind == "zero": data[i : i + n] = bytes(n)
        elif kind == "swap" and abs(i - j) >= n:
            data[i : i + n], data[j : j + n] = data[j : j + n], data[i : i + n]
        elif kind == "copy": data[i : i + n] = data[j : j + n]
        elif kind == "extend": data += rng.randbytes(n)
        elif kind == "cut" and i > 1024: del data[i:]
    return bytes(data)

for _ in range(int(sys.argv[3])):
    for resealed in (False, True):
        data = seal(mutated(good[512:])) if resealed else mutated(good)
        if data == good:
            continue
        try:
            read = store.decode(data, "fuzz.h5")
        except ArtifactError:
            counts["refused"] += 1
        else:
            # Sealed by an attacker, other numbers are another skill; but without a seal nothing is read.
            assert resealed, "a changed file was read"
            counts["same" if read.digest == digest else "another skill"] += 1
print(json.dumps(counts))
"""


@pytest.mark.parametrize("seed", [0, 1])
def test_no_mutation_crashes_hangs_or_goes_unnoticed(tmp_path, good, seed):
    (path := tmp_path / "good.h5").write_bytes(good)
    child = python(FUZZ, path, seed, 400)
    output, said = child.communicate(timeout=120)
    assert (child.returncode, said) == (0, "")
    counts = json.loads(output)
    assert sum(counts.values()) > 700
    assert counts["refused"] > 500


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
