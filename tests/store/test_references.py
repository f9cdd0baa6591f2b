"""What names a skill, and what does not."""

from pathlib import Path

import pytest

from skillctl.errors import UsageError
from skillctl.store.references import Reference, parse_reference, require_name

BAD_NAMES = [
    "", ".", "..", "../x", "a/b", "a\0", "a\n", "\na", "-rf", ".hidden", "_x", "x" * 65, "Reach", "über",
    "a b", "a@1", "\x1b[2J", "a\u202e", "x.h5", "x.h5\n", "sha256:00000000",
]  # fmt: skip


@pytest.mark.parametrize("name", BAD_NAMES, ids=repr)
def test_names_that_are_refused(name):
    with pytest.raises(UsageError, match="cannot name a skill") as caught:
        require_name(name)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 200
    assert caught.value.hint


@pytest.mark.parametrize("name", ["a", "7", "reach-left", "reach_left.v2", "x" * 64, "a.h5.b", "latest"])
def test_names_that_are_taken(name):
    assert require_name(name) == name


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("reach", Reference("reach", "latest")),
        ("reach@latest", Reference("reach", "latest")),
        ("reach@3", Reference("reach", 3)),
        ("reach@999999", Reference("reach", 999_999)),
        ("reach@champion", Reference("reach", "champion")),
        ("reach@sha256:0123abcd", Reference("reach", "sha256:0123abcd")),
        (f"reach@sha256:{'0' * 64}", Reference("reach", f"sha256:{'0' * 64}")),
        ("reach.h5", Path("reach.h5")),
        ("./reach", Path("reach")),
        ("/tmp/x@1.h5", Path("/tmp/x@1.h5")),
        ("a/b", Path("a/b")),
        ("../x", Path("../x")),
        ("-rf.h5", Path("-rf.h5")),
    ],
)
def test_references(text, expected):
    assert parse_reference(text) == expected


@pytest.mark.parametrize("text", [
    "", "@1", "reach@", "reach@0", "reach@-1", "reach@1e3", "reach@01", "reach@1000000", "reach@1.0",
    "reach@ 1", "reach@1@2", "reach@Champion", "reach@sha256:", "reach@sha256:0123abc",
    "reach@sha256:0123ABCD", "reach@sha256:0123abcx", f"reach@sha256:{'0' * 65}", "reach@1\n", "reach\n",
    "a\0.h5", "Reach", ".", "-rf", "reach@\x1b[2J", "reach@\N{ARABIC-INDIC DIGIT THREE}",
], ids=repr)  # fmt: skip
def test_what_is_no_reference(text):
    with pytest.raises(UsageError) as caught:
        parse_reference(text)
    assert str(caught.value).isprintable()
    assert "name@3" in caught.value.hint
