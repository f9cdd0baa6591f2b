"""Every error message, word by word: what a stranger reads who made a mistake.

The golden file is also the table: each line ``$ skillctl …`` in it is run, in a directory with the files
that `_place` makes, and what follows is what was said. To add a message, or after changing one:

    WRITE_MESSAGES=1 python -m pytest tests/cli/test_messages.py

and read the difference as a stranger would. Figures with three and more decimals are shown as N.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from skillctl.usecases.files import load, save

GOLDEN = Path(__file__).parent.parent / "golden" / "messages.txt"
HAS_PYBULLET = importlib.util.find_spec("pybullet") is not None
GOOD = "t,x,y\n0,0,0\n0.1,0.1,0\n0.2,0.2,0.1\n0.3,0.3,0.1\n"

TABLES = {
    "empty.csv": "",
    "header.csv": "t,x,y\n",
    "letters.csv": GOOD.replace("0.2,0.1", "0.2,abc"),
    "nan.csv": GOOD.replace("0.2,0.1", "nan,0.1"),
    "short.csv": "t,x,y\n0,0,0\n",
    "still.csv": "t,x,y\n0,1,2\n0.1,1,2\n0.2,1,2\n",
    "backwards.csv": "t,x,y\n0,0,0\n0.2,1,0\n0.1,2,0\n",
    "timeless.csv": "x,y\n0,0\n1,1\n2,1\n",
    "ragged.csv": "t,x,y\n0,0,0\n0.1,1\n",
    "words.csv": "hello world\nthis is no table\n",
    "names.csv": "time,left,right\n0,0,0\n0.1,1,0\n0.2,1,1\n",
    "notes.txt": "mine",
    "note.h5": "not a skill",
    "none.h5": "",
    "misspelt.toml": "[[skills]]\nname = 'a'\ndata = '0.csv'\nsed = 1\n",
    "wrong.toml": "[options]\nunits = 'yd'\n[[skills]]\nname = 'a'\ndata = '0.csv'\n",
    "placeless.toml": "[[skills]]\ndata = '0.csv'\n",
    "twice.toml": "[[skills]]\nname = 'a'\ndata = '0.csv'\n[[skills]]\nname = 'a'\ndata = '1.csv'\n",
    "lost.toml": "[[skills]]\nname = 'a'\ndata = 'no/*.csv'\n[[skills]]\nname = 'b'\ndata = 'nan.csv'\n",
}


def _place(folder, library, curve_files, reach_files, save_with_matrix):
    """Make the files that the command lines of the golden file speak of."""
    for name in ("curve", "hook", "plain", "reach"):  # other tests may have left more in there
        shutil.copytree(library / name, folder / "skills" / name)
    for name, text in TABLES.items():
        (folder / name).write_text(text)
    for number, file in enumerate(curve_files):
        shutil.copy(file, folder / f"{number}.csv")
    shutil.copy(reach_files[0], folder / "space.csv")
    (folder / "noise.csv").write_bytes(b"t,x\n\x00\x01\x02")
    (folder / "other.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    data = bytearray((folder / "skills" / "curve" / "1.h5").read_bytes())
    (folder / "cut.h5").write_bytes(data[: len(data) // 2])
    data[len(data) // 2] ^= 1
    (folder / "flipped.h5").write_bytes(data)
    (folder / "skills" / "reach" / "refs.toml").write_text("[aliases]\nrelease = 1\n")
    (folder / "skills" / "plain" / "refs.toml").write_text("<<<<<<< ours\n")
    save_with_matrix("curve", 0, np.eye(2), folder / "unstable.h5")
    from skillctl.compose.combine import combine

    save(combine([load(folder / f"skills/{name}/1.h5") for name in ("curve", "hook")]), folder / "either.h5")


@pytest.fixture(scope="module")
def place(library, curve_files, reach_files, tmp_path_factory, save_with_matrix):
    folder = tmp_path_factory.mktemp("messages")
    _place(folder, library, curve_files, reach_files, save_with_matrix)
    return folder


def said(run, line):
    """Return what a command line leads to: the exit code and what is said on standard error."""
    result = run(*shlex.split(line))
    assert result.exit_code, f"skillctl {line}: is no mistake"
    shown = re.sub(r"\d+\.\d{3,}", "N", result.stderr).replace(f"{Path.cwd()}/", "HERE/")
    shown = re.sub(r"\d+ bytes after the seal, \d+ were", "N bytes after the seal, N were", shown)
    return f"$ skillctl {line}".rstrip() + f"\n[{result.exit_code}] {shown}"


def test_every_message_is_as_it_was_read_and_approved(run, place, monkeypatch):
    monkeypatch.chdir(place)
    heading, *expected = GOLDEN.read_text(encoding="utf-8").split("\n\n")
    lines = [block.partition("\n")[0].removeprefix("$ skillctl ") for block in expected]
    before = sorted(place.rglob("*"))
    found = [said(run, line).strip() for line in lines if _is_possible(line)]
    assert sorted(place.rglob("*")) == before, "an error left something behind"
    if os.environ.get("WRITE_MESSAGES"):
        assert HAS_PYBULLET
        GOLDEN.write_text("\n\n".join([heading, *found]) + "\n", encoding="utf-8")
        return
    possible = [block.strip() for line, block in zip(lines, expected, strict=True) if _is_possible(line)]
    assert found == possible


def _is_possible(line):
    return HAS_PYBULLET or not line.startswith("simulate")


def test_every_message_has_a_next_step():
    for block in GOLDEN.read_text(encoding="utf-8").split("\n\n")[1:]:
        for error in re.findall(r"error: .*(?:\n(?!error: |note: |warning: ).+)*", block):
            assert "\nhint: " in error, block
            assert error.partition("\n")[0].endswith((".", "?")), block
    assert "Traceback" not in GOLDEN.read_text(encoding="utf-8")
