"""--plot and --html: files that are what they say, in every command, and errors before any work."""

from __future__ import annotations

import json
import shutil
import subprocess
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from skillctl.cli.exit_codes import ExitCode
from skillctl.plotting.style import LEFT_OUT

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>&\"'"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Page(HTMLParser):
    """Tags, attributes and text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.text = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module", autouse=True)
def _coarse_grids():
    """Draw fewer points and streamlines than users get: the same pictures in a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skillctl.plotting.panels.REGION_GRID", 80)
        patch.setattr("skillctl.plotting.flow.DENSITY", 0.5)
        patch.setattr("skillctl.plotting.flow.DENSITY_OF_SMALL", 0.3)
        patch.setattr("skillctl.plotting.proof.FINENESS", {2: 61, 3: 21})
        yield


@pytest.fixture(scope="module")
def pages(library, curve_files, tmp_path_factory):
    """Pages of a learned skill with a hostile note, written twice, and of a combined one."""
    from typer.testing import CliRunner

    from skillctl.cli.app import app

    folder = tmp_path_factory.mktemp("pages")
    hostile = folder / "a<b>&c.h5"

    def run(*words):
        result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
        assert result.exit_code == 0, result.stderr

    run("learn", *curve_files, "--preset", "fast", "-o", hostile, "-m", HOSTILE)
    run("combine", "curve", "hook", "--store", library, "-o", folder / "both.h5")
    for skill, page in ((hostile, "hostile"), (hostile, "hostile-again"), (folder / "both.h5", "both")):
        run("inspect", skill, "--store", library, "--html", folder / f"{page}.html")
    return folder


def test_inspect_draws_in_every_format(run, tmp_path, library):
    for name in ("curve.png", "curve.svg", "curve.pdf"):
        result = run("inspect", "curve", "--store", library, "--plot", tmp_path / name)
        assert result.exit_code == 0, result.stderr
        assert result.stdout.startswith("skill ")
    with Image.open(tmp_path / "curve.png") as image:
        assert image.format == "PNG"
    assert ET.parse(tmp_path / "curve.svg").getroot().tag.endswith("svg")
    assert (tmp_path / "curve.pdf").read_bytes().startswith(b"%PDF")
    assert len(list(tmp_path.iterdir())) == 3  # nothing temporary is left


@pytest.mark.parametrize(
    "command",
    [
        ("inspect", "curve"),
        ("learn", "data.csv", "-o", "new.h5"),
        ("merge", "curve", "plain", "-o", "new.h5"),
        ("combine", "curve", "hook", "-o", "new.h5"),
        ("verify-stability", "curve"),
    ],
    ids=lambda command: command[0],
)
@pytest.mark.parametrize("place", ["picture.jpg", "missing/picture.png"])
def test_a_picture_that_cannot_be_written_is_refused_before_any_work(
    run, monkeypatch, tmp_path, library, curve_files, command, place
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(curve_files[0], "data.csv")
    result = run(*command, "--store", library, "--plot", place)
    code = ExitCode.USAGE if "jpg" in place else ExitCode.STORE
    assert (result.exit_code, result.stdout) == (code, "")
    assert (".png, .svg, .pdf" if "jpg" in place else "missing: there is no such directory") in result.stderr
    assert "hint:" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]


def test_learn_draws_the_same_when_it_learns_and_when_it_is_up_to_date(run, tmp_path, reach_files):
    words = [
        "learn",
        *reach_files,
        "--preset",
        "fast",
        "--components",
        2,
        "--validate",
        "-o",
        tmp_path / "a.h5",
    ]
    first, second = tmp_path / "first.svg", tmp_path / "second.svg"
    assert run(*words, "--plot", first).exit_code == 0
    result = run(*words, "--plot", second)
    assert "up to date" in result.stdout
    assert first.read_bytes() == second.read_bytes()
    assert f"stroke: {LEFT_OUT.lower()}" in first.read_text(encoding="utf-8")  # demonstrations left out


@pytest.mark.parametrize("command", ["merge", "combine"])
def test_a_child_is_drawn_beside_its_parents_also_when_it_is_up_to_date(run, tmp_path, library, command):
    words = [command, "curve", "plain", "--store", library, "-o", tmp_path / "child.h5"]
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    for picture in (first, second):
        result = run(*words, "--plot", picture)
        assert result.exit_code == 0, result.stderr
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as image:
        assert image.width > 2 * image.height  # three panels side by side


def test_certificates_are_drawn_of_all_skills_that_can_be_read(run, tmp_path, library):
    (tmp_path / "broken.h5").write_bytes(b"not a skill")
    both = tmp_path / "both.png"
    result = run(
        "verify-stability", "curve", tmp_path / "broken.h5", "reach", "--store", library, "--plot", both
    )
    assert result.exit_code == ExitCode.REFUSED
    with Image.open(both) as image:
        assert image.height > image.width  # one below the other
    result = run("verify-stability", tmp_path / "broken.h5", "--plot", tmp_path / "none.png")
    assert result.exit_code == ExitCode.REFUSED
    assert not (tmp_path / "none.png").exists()


def test_too_many_certificates_for_one_picture_are_refused(run, tmp_path, library):
    result = run("verify-stability", *["curve"] * 13, "--store", library, "--plot", tmp_path / "a.png")
    assert result.exit_code == ExitCode.USAGE
    assert "13 skills" in result.stderr


def test_json_stays_json_beside_a_picture(run, tmp_path, library):
    result = run("inspect", "curve", "--store", library, "--json", "--plot", tmp_path / "curve.png")
    assert json.loads(result.stdout)["skill"] == "curve@1"
    assert result.stderr == ""


@pytest.mark.parametrize("name", ["page.pdf", "page", "missing/page.html"])
def test_a_page_that_cannot_be_written_is_refused(run, tmp_path, library, name):
    result = run("inspect", "curve", "--store", library, "--html", tmp_path / name)
    code = ExitCode.STORE if "missing" in name else ExitCode.USAGE
    assert (result.exit_code, result.stdout) == (code, "")
    assert list(tmp_path.iterdir()) == []


def test_the_same_skill_gives_the_same_page(pages):
    assert (pages / "hostile.html").read_bytes() == (pages / "hostile-again.html").read_bytes()


def test_nothing_from_a_file_is_markup(pages):
    page = Page((pages / "hostile.html").read_text(encoding="utf-8"))
    assert not {"script", "iframe", "object", "b"} & set(page.tags)
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert HOSTILE in page.text
    assert any("a<b>&c.h5" in text for text in page.text)
    assert page.tags.count("img") == 3


def test_a_page_needs_nothing_but_itself(pages):
    for path in pages.glob("*.html"):
        page = Page(path.read_text(encoding="utf-8"))
        sources = [value for name, value in page.attributes if name in ("src", "href", "srcset", "action")]
        assert all(value.startswith("data:") for value in sources)
        policies = [value for _, value in page.attributes if value and value.startswith("default-src")]
        assert policies[0].startswith("default-src 'none'; img-src data:;")
        assert not [value for _, value in page.attributes if value and "http" in value.lower()]


def test_a_page_tells_verdict_proof_parts_and_lineage(pages):
    text = " ".join(Page((pages / "both.html").read_text(encoding="utf-8")).text)
    for expected in (
        "stable",
        "The proof",
        "Part 2 shrinks",
        "curve@1",
        "hook@1",
        "left-out starts in it",
        "present",
    ):
        assert expected in text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on PATH")
def test_a_browser_shows_the_page_without_asking_anybody(pages, tmp_path):
    page = pages / "hostile.html"
    shot, log = tmp_path / "page.png", tmp_path / "network.json"
    command = [
        *(CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"),
        *("--disable-component-update", "--no-first-run", f"--user-data-dir={tmp_path / 'profile'}"),
        *("--enable-logging=stderr", f"--log-net-log={log}", f"--screenshot={shot}"),
        *("--window-size=900,3000", page.as_uri()),
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert "CONSOLE" not in result.stderr
    events = json.loads(log.read_text(encoding="utf-8"))["events"]
    initiators = {e["params"].get("initiator") for e in events if "url" in e.get("params", {})}
    assert initiators <= {None, "not an origin"}  # the browser asks for updates; a page would be an origin
    with Image.open(shot) as image:  # the pictures are there: their blue motions
        pixels = np.asarray(image.convert("RGB"), dtype=int)
        blues = (np.abs(pixels - [0, 0x72, 0xB2]) < 20).all(axis=-1).sum()
    assert blues > 500
