"""Reports as text and as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from skillctl.cli import render, words
from skillctl.errors import ArtifactError


@dataclass(frozen=True)
class Sample:
    """A report with one field of each kind."""

    number: float
    missing: float
    path: Path
    array: np.ndarray
    scalar: np.float64
    nested: tuple[dict[str, object], ...]
    error: ArtifactError


def test_json_holds_every_kind_of_value_and_no_nan():
    sample = Sample(
        number=0.1,
        missing=float("nan"),
        path=Path("a/b"),
        array=np.array([[1.0, np.inf]]),
        scalar=np.float64(2.5),
        nested=({"yes": True, "none": None, "int": 3},),
        error=ArtifactError("x is damaged.", hint="Copy it again."),
    )
    assert json.loads(render.to_json(sample)) == {
        "schema_version": 2,
        "number": 0.1,
        "missing": None,
        "path": "a/b",
        "array": [[1.0, None]],
        "scalar": 2.5,
        "nested": [{"yes": True, "none": None, "int": 3}],
        "error": {"code": 7, "message": "x is damaged.", "hint": "Copy it again."},
    }


def test_plain_text_aligns_words_left_and_numbers_right():
    table = render.Table(("name", "error"), (("a", "1.5 mm"), ("long", "12.25 mm"), ("b", "–")))
    facts = render.Facts((("verdict", "stable"), ("rate", "1 1/s")))
    assert render.to_text([table, facts, "The end.", render.Lines("Why", ("One.", "Two."))]) == (
        "name     error\na       1.5 mm\nlong  12.25 mm\nb            –\n"
        "\nverdict  stable\nrate     1 1/s\n"
        "\nThe end.\n"
        "\nWhy\n  One.\n  Two.\n"
    )


def test_no_cell_can_command_the_terminal():
    blocks = [
        render.Table(("a\x1b[1m",), (("b\x1b]0;x\x07",),)),
        render.Facts((("c\x07", "d\u202e"),)),
        "e\r",
        render.Lines("f\x1b", ("g\x9b",)),
    ]
    for text in (render.to_text(blocks), render.to_terminal(blocks, coloured=False)):
        assert not set(text) & set("\x1b\x07\r\x9b\u202e")


def test_markup_in_names_is_text():
    block = render.Table(("name",), (("[red]x[/red]",),))
    assert "[red]x[/red]" in render.to_terminal([block, "[bold]y"], coloured=True)


def test_lengths_are_said_in_the_unit_that_people_use():
    assert words.length(0.00123, "m") == "1.23 mm"
    assert words.length(0.00123, "rad") == "0.0012 rad"
    assert words.length(None, "m") == words.length(float("nan"), "m") == "–"
    assert words.per_second(0.5, "m") == "500.00 mm/s"


def test_proved_numbers_are_rounded_to_the_safe_side():
    rate, period, frequency = words.rate_and_period(0.012399, 0.0012399)
    assert (rate, period) == ("0.0123 1/s", "0.00123 s")
    assert frequency == "807 Hz"  # 1 / 0.0012399 = 806.5: a slower controller has no proof


WIDE = render.Table(
    ("skill", "verdict", "scope", "rate", "period", "controller ≥", "components", "digest"),
    (
        ("bottom-left@1", "stable", "global", "0.0887 1/s", "0.116 s", "8.62 Hz", "7", "3d06ed542de0"),
        ("  part 1", "stable", "", "0.0887 1/s", "0.133 s", "7.51 Hz", "7", ""),
    ),
)
DIGEST = f"sha256:{64 * '7'}"


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_no_word_and_no_short_cell_is_broken_on_a_narrow_terminal(width):
    facts = render.Facts((("controller period", "up to 0.133 s (7.51 Hz or faster)"), ("digest", DIGEST)))
    long = render.Table(("name", "why"), (("curve", "a sentence of so many words that it takes lines " * 2),))
    shown = render.to_terminal([WIDE, facts, long], coloured=False, width=width)
    lines = shown.split("\n")
    assert max(map(len, lines)) <= width
    for cell in (*WIDE.headings, *(cell.strip() for row in WIDE.rows for cell in row)):
        assert any(cell in line for line in lines)
    for word in ("controller period", "up to 0.133 s", *long.rows[0][1].split()):
        assert any(word in line for line in lines)
    assert (DIGEST in lines or f"  {DIGEST}" in lines or f"digest             {DIGEST}" in lines) == (
        width > 73
    )
    tables = shown.split("\n\n")
    assert all(table.startswith("skill") and "bottom-left@1" in table for table in tables[:-2])
    assert len(tables) == {40: 4, 60: 2, 80: 2, 120: 1}[width] + 2


def test_wide_letters_take_two_columns():
    table = render.Table(("名", *"abc"), (("名" * 12, *("名" * 10,) * 3),))
    shown = render.to_terminal([table], coloured=False, width=80)
    assert shown.count("名" * 10) == 5  # four cells in two tables, the first of them in both
