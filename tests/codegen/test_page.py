"""The page on C is true: its program compiles, and its motion arrives."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import skillctl

PAGE = Path(skillctl.__file__).parent / "docs" / "c.md"
SKILL = Path(skillctl.__file__).parent.parent / "skills" / "shelf" / "1.h5"


def test_the_program_of_the_page_arrives(run, tmp_path):
    (program,) = re.findall(r"```c\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    (tmp_path / "main.c").write_text(program)
    assert run("export", SKILL, "-o", tmp_path / "shelf.h").exit_code == 0
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["cc", *strict, "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    printed = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(r"arrived after \d+\.\d s\n", printed)
    assert 0.5 < float(printed.split()[2]) < 59  # it is 0.5 m at the least, or the time is up
