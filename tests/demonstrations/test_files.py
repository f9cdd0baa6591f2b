"""What a file's child does to it, in words."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from skillctl.demonstrations.files import LIMITS, NO_PLUGINS, File
from skillctl.errors import InputDataError
from skillctl.workers.child import Child
from skillctl.workers.limits import Limits

PARSERS = """
import os, signal, time
from pathlib import Path
from skillctl.errors import InputDataError

def crash(content): os.kill(os.getpid(), signal.SIGSEGV)
def sleep(content): time.sleep(60)
def exhaust(content): return bytes(2**34)
def fail(content): raise KeyError("\\x1b[2J" + 500 * "x")
def refuse(content): raise InputDataError("it is blue.", hint="Paint it.")
def plugins(content): return os.environ["HDF5_PLUGIN_PRELOAD"]
def count(content, folder):
    Path(folder, "parsed").mkdir()  # fails the second time; a directory is no file that has a size
    return len(content)
"""


@pytest.fixture(scope="module", autouse=True)
def parsers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    folder = tmp_path_factory.mktemp("parsers")
    (folder / "parsers_for_tests.py").write_text(PARSERS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield import_module("parsers_for_tests")


@pytest.fixture(scope="module")
def child(parsers) -> Iterator[Child]:
    """A child of this module: it finds the parsers."""
    with Child(LIMITS, NO_PLUGINS) as child:
        yield child


def refusal(parser: Callable[..., object], child: Child) -> str:
    with pytest.raises(InputDataError) as caught:
        File(Path("reach.bin"), b"bytes", None, child).parsed(parser, "XYZ file")
    message = str(caught.value)
    assert message.startswith("reach.bin: ")
    assert message.isprintable()
    assert caught.value.hint
    return message.removeprefix("reach.bin: ")


@pytest.mark.parametrize(
    ("parser", "words"),
    [
        ("crash", "not an intact XYZ file (the process that reads it ends with SIGSEGV)."),
        ("exhaust", "reading this XYZ file takes more than 2048 MiB of memory."),
        ("refuse", "it is blue."),
    ],
)
def test_whatever_a_parser_does_ends_in_a_sentence(child, parsers, parser: str, words: str) -> None:
    assert refusal(getattr(parsers, parser), child) == words


def test_what_a_library_says_is_short_and_safe_to_print(child, parsers) -> None:
    message = refusal(parsers.fail, child)
    assert message.startswith("not an intact XYZ file ('\\x1b[2Jxxx")
    assert len(message) < 150


def test_a_parser_that_hangs_is_stopped(parsers) -> None:
    assert LIMITS.seconds < 9  # [s]; a command answers within ten, its own start included
    with Child(Limits(seconds=3.0)) as child:
        assert refusal(parsers.sleep, child) == "reading this XYZ file takes longer than 3 s."


def test_a_process_that_does_not_start_is_said_to(monkeypatch, parsers) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with Child(LIMITS) as child:
        assert "needs a process of its own, which does not start" in refusal(parsers.refuse, child)


def test_a_file_is_parsed_once_and_without_filter_plugins(child, parsers, tmp_path) -> None:
    file = File(Path("reach.bin"), b"bytes", None, child)
    assert file.parsed(parsers.count, "XYZ file", folder=str(tmp_path)) == 5
    assert file.parsed(parsers.count, "XYZ file", folder=str(tmp_path)) == 5
    assert file.parsed(parsers.plugins, "XYZ file") == "::"
