"""The README and its pages are true: what they say to type runs, and prints what they show."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest

from skillctl.cli.app import COMMANDS
from skillctl.cli.exit_codes import ExitCode

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
HAS_PYBULLET = importlib.util.find_spec("pybullet") is not None
DOCS = ROOT / "skillctl" / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]


def _script():
    """Return `.ci/readme`, which types what the pages say, as a module."""
    loader = SourceFileLoader("readme", str(ROOT / ".ci" / "readme"))
    spec = importlib.util.spec_from_loader("readme", loader)
    module = importlib.util.module_from_spec(spec)
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # no cache beside the script
    try:
        loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = written
    return module


SCRIPT = _script()
pytestmark = pytest.mark.timeout(900)  # [s]; the whole tour is one fixture, 45 s of CPU


def blocks(language: str) -> list[str]:
    """Return the code blocks of a language."""
    return [block.strip() for block in re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)]


def test_two_lines_are_to_be_pasted():
    install, test = blocks("sh")
    for line in (install, test):
        assert "\n" not in line
        assert line.startswith('V="${V:-.venv}"; python3 -m venv "$V" && "$V/bin/python" -m pip install ')
    assert install.endswith('"$V/bin/skillctl" quickstart')
    assert "-m pytest" in test


def test_ci_runs_exactly_the_test_line_of_the_readme():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    (command,) = re.findall(r'line="\$\((.*)\)"', script)
    found = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == blocks("sh")[1]
    assert 'bash -euo pipefail -c "$line"' in script


def test_every_command_is_named_and_every_command_typed_exists():
    typed = {
        word
        for page in PAGES
        for word in re.findall(
            r"^\$? ?skillctl (?:-q )?([a-z][a-z-]*)", page.read_text("utf-8"), re.MULTILINE
        )
    }
    assert typed <= set(COMMANDS)
    (around,) = re.findall(r"^And around them:\n\n(.*?)\n\n", README, re.MULTILINE | re.DOTALL)
    main = set(re.findall(r"^\*\*([a-z-]+)\*\*", README, re.MULTILINE))
    assert len(main) == 9
    assert main | set(re.findall(r"`([a-z][a-z-]*)(?: [^`]*)?`", around)) == set(COMMANDS)


def test_every_exit_code_is_explained():
    page = (DOCS / "pipelines.md").read_text(encoding="utf-8")
    table = "".join(re.findall(r"^\| [\d, ]+ \|", page, re.MULTILINE))
    assert {int(code) for code in re.findall(r"\d+", table)} == set(ExitCode)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_and_pictures_lead_somewhere(page):
    targets = re.findall(r"\]\((?!https:)([^)#]*)", page.read_text(encoding="utf-8"))
    for target in filter(None, targets):
        assert (page.parent / target).is_file(), target


def test_pictures_are_shown_and_small():
    shown = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for picture in (ROOT / ".github").glob("*.png"):
        assert picture.name in shown
        assert picture.stat().st_size < 300_000, picture


def test_the_readme_is_short_and_leads_to_every_page():
    assert README.count("\n") <= 300
    for page in DOCS.glob("*.md"):
        assert f"](skillctl/docs/{page.name})" in README
        if SCRIPT.BLOCK.search(page.read_text(encoding="utf-8")):
            assert page.stem in SCRIPT.PAGES


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    """What came of every block of every page, run one after the other by a newcomer."""
    folder = tmp_path_factory.mktemp("tour")
    pages = [ROOT / "README.md", *(DOCS / f"{name}.md" for name in SCRIPT.PAGES)]
    return {"folder": folder, **{page.stem: list(SCRIPT.followed(page, folder)) for page in pages}}


def shape(text: str) -> str:
    """Return a line with digests, numbers and gaps made equal: those differ between machines and builds."""
    text = re.sub(r"\b[0-9a-f]{12,}\b", "DIGEST", text)
    text = re.sub(r"\d[\d.]*", "N", text)
    return re.sub(r"\s+", " ", text).strip()


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
@pytest.mark.parametrize("page", ["README", *SCRIPT.PAGES])
def test_every_block_runs_and_the_outputs_shown_are_real(tour, page):
    assert tour[page]
    for language, body, result in tour[page]:
        assert result.returncode == 0, f"{body}\n{result.stdout}{result.stderr or ''}"
        if language == "console":
            found = [shape(line) for line in result.stdout.strip().split("\n")]
            expected = [shape(line) for line in body.strip().split("\n")[1:]]
            assert found == expected, f"{body}: .ci/readme writes it anew"


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
def test_the_loop_for_a_robot_arrives(tour):
    (printed,) = [result.stdout for language, _, result in tour["robot"] if language == "python"]
    assert re.fullmatch(r"arrived after [\d.]+ s, \d+ steps were too late\n", printed)


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
def test_the_loop_for_a_robot_refuses_a_period_beyond_the_proof(tour):
    (loop,) = [body for language, body, _ in tour["robot"] if language == "python"]
    slow = loop.replace(
        '(FakeRobot(), "skills/shelf/1.h5")', '(FakeRobot(), "skills/shelf/1.h5", period=1.0)'
    )
    assert slow != loop
    refused = SCRIPT.run("python", slow, tour["folder"] / "quickstart")
    assert refused.returncode == 1
    assert "UsageError: period: 1 s is too long: at most 0." in refused.stderr
