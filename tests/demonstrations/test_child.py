"""The child that parses: what comes back, and that nothing a parser does reaches its parent."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from skillctl.demonstrations import child as child_module
from skillctl.demonstrations import serving
from skillctl.demonstrations.child import Child
from skillctl.errors import InputDataError

PARSERS = """
import os, signal, sys, time
import numpy as np
from skillctl.errors import InputDataError

def values(content):
    cube = np.arange(24, dtype="i2").reshape(2, 3, 4)
    fortran = np.asfortranarray(cube[0])
    return {"cube": cube, "empty": np.zeros((0, 3)), "list": [1, "two", None, [fortran, 0.5]], "": {}}

def size(content, factor): return factor * len(content)
def identity(content): return os.getpid()
def crash(content): os.kill(os.getpid(), signal.SIGSEGV)
def leave(content): os._exit(3)
def spin(content):
    while True: pass
def sleep(content): time.sleep(60)
def exhaust(content): return np.ones(2**31)  # 16 GiB
def fail(content): raise KeyError("\\x1b[2J" + 500 * "x")
def refuse(content): raise InputDataError("it is blue.", hint="Paint it.")
def many(content): return list(range(100_001))
def large(content): return [np.zeros(2**24), np.zeros(2**24), np.zeros(1)]
def chatter(content):
    os.write(1, b"noise"); os.write(2, b"noise"); print("noise", flush=True)
    return 1
def nonsense(content):
    for descriptor in range(3, 20):
        try: os.write(descriptor, b"\\xff" * 16)
        except OSError: pass
    time.sleep(60)
def write(content, target):
    with open(target, "wb") as file: file.write(content)
def limits(content):
    import resource
    names = ("RLIMIT_AS", "RLIMIT_CPU", "RLIMIT_CORE", "RLIMIT_FSIZE")
    return {name: resource.getrlimit(getattr(resource, name))[0] for name in names}
def surroundings(content):
    return [sys.flags.isolated, os.environ["HDF5_PLUGIN_PRELOAD"], "resource" in sys.modules]
"""


@pytest.fixture(scope="module", autouse=True)
def parsers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """A module of parsers that the child can import, because its parent can."""
    folder = tmp_path_factory.mktemp("parsers")
    (folder / "parsers_for_tests.py").write_text(PARSERS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield import_module("parsers_for_tests")


@pytest.fixture
def parse(child: Child) -> Callable[..., object]:
    def parse(parser: Callable[..., object], content: bytes = b"bytes", **options: object) -> object:
        return child.parse(parser, content, Path("reach.bin"), "XYZ file", **options)

    return parse


@pytest.fixture
def refusal(parse) -> Callable[..., str]:
    def refusal(parser: Callable[..., object], **options: object) -> str:
        with pytest.raises(InputDataError) as caught:
            parse(parser, **options)
        message = str(caught.value)
        assert message.startswith("reach.bin: ")
        assert message.isprintable()
        assert caught.value.hint
        return message.removeprefix("reach.bin: ")

    return refusal


def test_arrays_and_text_come_back_as_they_were(parse, parsers) -> None:
    there, here = parse(parsers.values), parsers.values(b"")
    assert (there["cube"] == here["cube"]).all()
    assert there["cube"].dtype == np.float64
    assert there["empty"].shape == (0, 3)
    (*plain, (fortran, half)) = there["list"]
    assert (plain, half, there[""]) == ([1, "two", None], 0.5, {})
    assert fortran.tolist() == here["list"][3][0].tolist()


def test_content_of_any_length_goes_in(parse, parsers) -> None:
    for length in (1, 2**16 - 1, 5 * 2**20):  # a pipe holds 64 KiB
        assert parse(parsers.size, bytes(length), factor=2) == 2 * length


def test_files_share_one_process_until_one_ends_it(parse, refusal, parsers, monkeypatch) -> None:
    first = parse(parsers.identity)
    assert first != os.getpid()
    refusal(parsers.fail)
    refusal(parsers.refuse)
    assert parse(parsers.identity) == first
    with monkeypatch.context() as patch:
        patch.setattr(child_module, "TIME_LIMIT", 0.5)
        parse(parsers.identity)
        time.sleep(0.7)  # the time of the next file does not run yet
        assert parse(parsers.identity) == first
    refusal(parsers.crash)
    assert parse(parsers.identity) != first


def test_no_process_is_left_behind(parsers) -> None:
    with Child() as child:
        pid = child.parse(parsers.identity, b"", Path("reach.bin"), "XYZ file")
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    child.close()


@pytest.mark.parametrize(
    ("parser", "words"),
    [
        ("crash", "not an intact XYZ file (the process that reads it ends with SIGSEGV)."),
        ("leave", "not an intact XYZ file (the process that reads it ends with status 3)."),
        ("nonsense", "not an intact XYZ file (the process that reads it answers nonsense)."),
        ("exhaust", "reading this XYZ file takes more than 2048 MiB of memory."),
        ("many", "not an intact XYZ file (it holds more than 100000 values)."),
        ("large", "not an intact XYZ file (too large: more than 256 MiB of numbers)."),
        ("refuse", "it is blue."),
    ],
)
def test_whatever_a_parser_does_ends_in_a_sentence(refusal, parse, parsers, parser: str, words: str) -> None:
    assert refusal(getattr(parsers, parser)) == words
    assert parse(parsers.size, factor=1) == 5  # and the next file is read


def test_what_a_library_says_is_short_and_safe_to_print(refusal, parsers) -> None:
    message = refusal(parsers.fail)
    assert "\\x1b[2Jxxx" in message
    assert len(message) < 150


@pytest.mark.parametrize("parser", ["spin", "sleep"])
def test_a_parser_that_hangs_is_stopped(refusal, parse, parsers, monkeypatch, parser: str) -> None:
    assert child_module.TIME_LIMIT < 9  # [s]; a command answers within ten, its own start included
    first = parse(parsers.identity)  # starting counts, and may take long on a busy machine
    with monkeypatch.context() as patch:
        patch.setattr(child_module, "TIME_LIMIT", 0.5)
        assert refusal(getattr(parsers, parser)) == "reading this XYZ file takes longer than 0.5 s."
    assert parse(parsers.identity) != first


def test_a_child_that_takes_no_input_is_stopped_too(monkeypatch) -> None:
    monkeypatch.setattr(child_module, "TIME_LIMIT", 0.5)
    monkeypatch.setattr(child_module, "START", "import time; time.sleep(60)")
    with Child() as child, pytest.raises(InputDataError, match=r"takes longer than 0\.5 s"):
        child.parse(np.array, bytes(2**20), Path("reach.bin"), "XYZ file")


def test_a_child_that_does_not_start_is_said_to(monkeypatch, parsers) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with Child() as child, pytest.raises(InputDataError, match="which does not start"):
        child.parse(parsers.size, b"", Path("reach.bin"), "XYZ file", factor=1)


def test_limits_hold_in_the_child_and_not_in_its_parent(parse, parsers) -> None:
    resource = pytest.importorskip("resource")
    before = parsers.limits(b"")
    found = parse(parsers.limits)
    assert (found["RLIMIT_AS"], found["RLIMIT_CORE"], found["RLIMIT_FSIZE"]) == (2**31, 0, 0)
    # Rounded down and one added; what the child has used already counts.
    assert serving.TIME_LIMIT <= found["RLIMIT_CPU"] <= 2 * serving.TIME_LIMIT
    assert parsers.limits(b"") == before
    assert before["RLIMIT_FSIZE"] == resource.RLIM_INFINITY


def test_a_parser_writes_no_files_and_says_nothing(parse, refusal, parsers, tmp_path, capfd) -> None:
    assert parse(parsers.chatter) == 1
    assert "not an intact XYZ file" in refusal(parsers.write, target=str(tmp_path / "planted"))
    assert (tmp_path / "planted").read_bytes() == b""
    assert capfd.readouterr() == ("", "")


def test_a_system_without_limits_reads_all_the_same(
    child, parse, refusal, parsers, tmp_path, monkeypatch
) -> None:
    (tmp_path / "resource.py").write_text("raise ImportError")
    monkeypatch.syspath_prepend(tmp_path)
    child.close()  # the next one finds that module
    isolated, plugins, limited = parse(parsers.surroundings)
    assert (isolated, plugins, limited) == (1, "::", False)
    assert parse(parsers.size, factor=1) == 5
    monkeypatch.setattr(child_module, "TIME_LIMIT", 0.5)
    assert refusal(parsers.sleep) == "reading this XYZ file takes longer than 0.5 s."  # and is gone


def test_a_child_ends_with_a_parent_that_is_killed(parsers) -> None:
    code = (
        "import os, sys, parsers_for_tests; from pathlib import Path\n"
        "from skillctl.demonstrations.child import Child\n"
        "print(Child().parse(parsers_for_tests.identity, b'', Path('a'), 'b'), flush=True)\n"
        "os.kill(os.getpid(), 9)"
    )
    surroundings = {**os.environ, "PYTHONPATH": str(Path(parsers.__file__).parent)}
    run = subprocess.run(
        [sys.executable, "-c", code], env=surroundings, capture_output=True, text=True, check=False
    )
    pid = json.loads(run.stdout)
    deadline = time.monotonic() + 10
    while Path(f"/proc/{pid}/cmdline").exists() and Path(f"/proc/{pid}/cmdline").read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.05)
