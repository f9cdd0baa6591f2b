"""The child that calls functions: what comes back, and that nothing they do reaches its parent."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from skillctl.errors import InputDataError
from skillctl.workers import child as child_module
from skillctl.workers import messages
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

LIMITS = Limits(seconds=20.0, memory=2**31, numbers=2**20)
CALLED = """
import os, signal, sys, time
import numpy as np
from skillctl.errors import InputDataError

class Odd(Exception):
    def __init__(self, number): self.number = number
    def __reduce__(self): return Odd, (self.number,)

def values():
    cube = np.arange(24, dtype="i2").reshape(2, 3, 4)
    fortran = np.asfortranarray(cube[0])
    return {"cube": cube, "empty": np.zeros((0, 3)), "list": [1, "two", None, [fortran, 0.5]], "": {}}

def size(content, factor=1): return factor * len(content)
def identity(): return os.getpid()
def crash(): os.kill(os.getpid(), signal.SIGSEGV)
def leave(): os._exit(3)
def spin():
    while True: pass
def sleep(marker=None):
    if marker: open(marker, "w").close()
    time.sleep(60)
def exhaust(): return np.ones(2**31)  # 16 GiB
def fail(): raise KeyError("odd")
def fail_wordlessly(): raise RuntimeError
def refuse(): raise InputDataError("it is blue.", hint="Paint it.")
def many(): return list(range(10**6))
def large(): return [np.zeros(2**16), np.zeros(2**16), np.zeros(1)]
def foreign(): return {1j}
def raise_odd(): raise Odd(7)
def unpicklable(): return lambda: None
def raise_unpicklable(): raise Odd(lambda: None)
def chatter():
    os.write(1, b"noise"); os.write(2, b"noise"); print("noise", flush=True)
    return 1
def nonsense():
    for descriptor in range(3, 20):
        try: os.write(descriptor, b"\\xff" * 16)
        except OSError: pass
    time.sleep(60)
def write(target):
    with open(target, "wb") as file: file.write(b"bytes")
def limits():
    import resource
    names = ("RLIMIT_AS", "RLIMIT_CPU", "RLIMIT_CORE", "RLIMIT_FSIZE")
    return {name: resource.getrlimit(getattr(resource, name))[0] for name in names}
def surroundings():
    threads, extra = os.environ["OMP_NUM_THREADS"], os.environ.get("EXTRA")
    return [sys.flags.isolated, threads, extra, "resource" in sys.modules]
"""


@pytest.fixture(scope="module", autouse=True)
def called(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """A module of functions that the child can import, because its parent can."""
    folder = tmp_path_factory.mktemp("called")
    (folder / "called_in_tests.py").write_text(CALLED)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield import_module("called_in_tests")


@pytest.fixture(scope="module")
def child() -> Iterator[Child]:
    """A process with limits; one for many tests, because starting it takes longer than they do."""
    with Child(LIMITS, {"EXTRA": "yes"}) as child:
        yield child


@pytest.fixture(scope="module")
def trusted() -> Iterator[Child]:
    with Child() as child:
        yield child


@pytest.fixture
def impatient() -> Iterator[Child]:
    with Child(Limits(seconds=3.0)) as child:
        yield child


# ------------------------------------------------------------------------------------- what comes back


def test_arrays_and_text_come_back_as_they_were(child, called) -> None:
    there, here = child.call(called.values), called.values()
    assert (there["cube"] == here["cube"]).all()
    assert there["cube"].dtype == np.float64
    assert there["empty"].shape == (0, 3)
    (*plain, (fortran, half)) = there["list"]
    assert (plain, half, there[""]) == ([1, "two", None], 0.5, {})
    assert fortran.tolist() == here["list"][3][0].tolist()


@pytest.mark.parametrize("length", [1, 2**16 - 1, 5 * 2**20])  # a pipe holds 64 KiB
def test_content_of_any_length_goes_in(child, called, length: int) -> None:
    assert child.call(called.size, bytes(length), factor=2) == 2 * length


@pytest.mark.parametrize(
    ("function", "kind", "words"),
    [
        ("crash", ChildDiedError, "ends with SIGSEGV"),
        ("leave", ChildDiedError, "ends with status 3"),
        ("nonsense", ChildDiedError, "answers nonsense"),
        ("exhaust", MemoryError, ""),
        ("many", ValueError, "it holds more than 4 MiB of text"),
        ("large", ValueError, "too large: more than 1 MiB of numbers"),
        ("foreign", ValueError, "no set can be handed over"),
        ("fail", ValueError, "'odd'"),
        ("fail_wordlessly", ValueError, "RuntimeError"),
        ("refuse", InputDataError, "it is blue."),
    ],
)
def test_whatever_a_function_does_ends_in_an_exception(child, called, function, kind, words) -> None:
    with pytest.raises(kind) as caught:
        child.call(getattr(called, function))
    assert str(caught.value) == words
    assert getattr(caught.value, "hint", "Paint it.") == "Paint it."
    assert child.call(called.size, b"bytes") == 5  # and the next call is answered


def test_without_limits_results_and_exceptions_are_what_they_are(trusted, called) -> None:
    with pytest.raises(called.Odd) as caught:
        trusted.call(called.raise_odd)
    assert caught.value.number == 7
    assert "in raise_odd" in str(caught.value.__cause__)
    with pytest.raises(Exception, match=r"[Pp]ickle"):
        trusted.call(called.unpicklable)
    with pytest.raises(RuntimeError, match="Odd: "):
        trusted.call(called.raise_unpicklable)
    assert trusted.call(called.foreign) == {1j}


def test_what_the_child_cannot_be_asked_leaves_it_as_it_is(trusted, called) -> None:
    first = trusted.call(called.identity)
    with pytest.raises(Exception, match=r"[Pp]ickle"):
        trusted.call(lambda: None)
    assert trusted.call(called.identity) == first


# ------------------------------------------------------------------------------------- answers of an enemy


def test_an_answer_is_read_as_it_was_written() -> None:
    stream = BytesIO()
    messages.send(stream, *messages.packed([np.array([1.5, 2.5]), {"a": np.eye(2)}], LIMITS))
    stream.seek(0)
    vector, item = messages.result(*messages.receive(stream, LIMITS), LIMITS)
    assert (vector.tolist(), item["a"].tolist()) == ([1.5, 2.5], [[1, 0], [0, 1]])


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        (b"not JSON", b""),
        (b"\xff", b""),
        (b"[]", b""),
        (b'{"refused": 1, "hint": "x"}', b""),
        (b'{"failed": null}', b""),
        (b"[" * 10**5, b""),
        (b'{"value": {"\\u0000": [2]}}', bytes(8)),
        (b'{"value": {"\\u0000": "ab"}}', bytes(8)),
        (b'{"value": {"\\u0000": 3}}', bytes(24)),
        (b'{"value": 1}', bytes(7)),
    ],
)
def test_an_answer_that_no_honest_child_gives_is_refused(text: bytes, numbers: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  # whose words nobody reads
        messages.result(bytearray(text), bytearray(numbers), LIMITS)


def test_an_answer_that_is_too_long_or_breaks_off_is_refused() -> None:
    for lengths in ((messages.MAX_TEXT + 1, 0), (0, LIMITS.numbers + 1)):
        with pytest.raises(ValueError, match="the answer is too long"):
            messages.receive(BytesIO(messages.HEADER.pack(*lengths)), LIMITS)
    for content in (b"", messages.HEADER.pack(10, 0) + b"{}"):
        with pytest.raises(EOFError):
            messages.receive(BytesIO(content), LIMITS)


# ------------------------------------------------------------------------------------- beginning and end


def test_calls_share_one_process_until_one_ends_it(child, called) -> None:
    first = child.call(called.identity)
    assert first != os.getpid()
    for function in (called.fail, called.refuse):
        with pytest.raises((ValueError, InputDataError)):
            child.call(function)
    assert child.call(called.identity) == first
    with pytest.raises(ChildDiedError):
        child.call(called.crash)
    assert child.call(called.identity) != first


def test_the_time_of_a_call_does_not_run_between_calls(impatient, called) -> None:
    first = impatient.call(called.identity)
    time.sleep(3.2)
    assert impatient.call(called.identity) == first


def test_no_process_is_left_behind(called) -> None:
    with Child() as child:
        pid = child.call(called.identity)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    child.close()
    with pytest.raises(ChildDiedError, match="was closed"):
        child.call(called.identity)


@pytest.mark.parametrize("function", ["spin", "sleep"])
def test_a_function_that_hangs_is_stopped(impatient, called, function: str) -> None:
    first = impatient.call(called.identity)
    with pytest.raises(TimeoutError):
        impatient.call(getattr(called, function))
    assert impatient.call(called.identity) != first


def test_a_child_that_takes_no_input_is_stopped_too(monkeypatch, impatient, called) -> None:
    monkeypatch.setattr(child_module, "START", "import time; time.sleep(60)")
    with pytest.raises(TimeoutError):
        impatient.call(called.size, bytes(2**20))


def test_a_child_that_does_not_start_is_said_to(monkeypatch, called) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with Child(LIMITS) as child, pytest.raises(FileNotFoundError):
        child.call(called.identity)


def test_another_thread_may_close_a_child_that_is_busy(called, tmp_path) -> None:
    raised: list[BaseException] = []

    def call() -> None:
        try:
            busy.call(called.sleep, str(tmp_path / "sleeps"))
        except ChildDiedError as error:
            raised.append(error)

    with Child() as busy:
        thread = threading.Thread(target=call)
        thread.start()
        wait_until(lambda: (tmp_path / "sleeps").exists())
    thread.join(timeout=20)
    assert [type(error) for error in raised] == [ChildDiedError]


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="asks Linux which processes run")
@pytest.mark.parametrize("busy", [False, True])
def test_a_child_ends_with_a_parent_that_is_killed(called, busy: bool) -> None:
    code = (
        "import os, sys, threading, called_in_tests; from skillctl.workers.child import Child\n"
        "child = Child(); pid = child.call(called_in_tests.identity)\n"
        "sleep = threading.Thread(target=child.call, args=(called_in_tests.sleep,), daemon=True)\n"
        f"if {busy}: sleep.start()\n"
        "import time; time.sleep(0.5); print(pid, flush=True); os.kill(os.getpid(), 9)"
    )
    surroundings = {**os.environ, "PYTHONPATH": str(Path(called.__file__).parent)}
    run = subprocess.run(
        [sys.executable, "-c", code], env=surroundings, stdout=subprocess.PIPE, text=True, check=False
    )
    pid = json.loads(run.stdout)
    command_line = Path(f"/proc/{pid}/cmdline")
    wait_until(lambda: not command_line.exists() or not command_line.read_bytes())


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


# ------------------------------------------------------------------------------------- limits


def test_limits_hold_in_the_child_and_not_in_its_parent(child, called) -> None:
    resource = pytest.importorskip("resource")
    before = called.limits()
    found = child.call(called.limits)
    assert (found["RLIMIT_AS"], found["RLIMIT_CORE"], found["RLIMIT_FSIZE"]) == (2**31, 0, 0)
    # Rounded down and one added; what the child has used already counts.
    assert LIMITS.seconds <= found["RLIMIT_CPU"] <= 2 * LIMITS.seconds
    assert called.limits() == before
    assert before["RLIMIT_FSIZE"] == resource.RLIM_INFINITY


def test_a_child_without_limits_has_its_parents(trusted, called) -> None:
    pytest.importorskip("resource")
    assert trusted.call(called.limits) == called.limits()


def test_a_function_writes_no_files_and_says_nothing(child, called, tmp_path, capfd) -> None:
    assert child.call(called.chatter) == 1
    with pytest.raises(ValueError, match="File too large"):
        child.call(called.write, str(tmp_path / "planted"))
    assert (tmp_path / "planted").read_bytes() == b""
    assert capfd.readouterr() == ("", "")


def test_a_child_is_isolated_and_has_one_thread_and_the_environment_it_is_given(child, called) -> None:
    assert child.call(called.surroundings) == [1, "1", "yes", True]


def test_a_system_without_limits_answers_all_the_same(called, tmp_path, monkeypatch) -> None:
    (tmp_path / "resource.py").write_text("raise ImportError")
    monkeypatch.syspath_prepend(tmp_path)
    with Child(Limits(seconds=3.0)) as child:
        assert child.call(called.surroundings) == [1, "1", None, False]
        with pytest.raises(TimeoutError):
            child.call(called.sleep)
