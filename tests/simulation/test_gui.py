from __future__ import annotations

import sys
import time

import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import NotFoundError
from skillctl.simulation.gui import Pace, require_window

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays are X11's here")


def test_without_a_display_a_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(NotFoundError, match="no display") as refusal:
        require_window()
    assert "--picture" in refusal.value.hint


def test_a_display_that_does_not_answer_ends_no_process_but_the_probe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DISPLAY", ":32123")
    with pytest.raises(NotFoundError, match="no window can be opened on the display ':32123'"):
        require_window()


def test_a_window_shows_real_time() -> None:
    began, pace = time.perf_counter(), Pace()
    for step in range(5):
        pace.wait(0.02 * step)
    assert time.perf_counter() - began >= 0.08
    pace.wait(-1.0)  # behind already: no waiting
