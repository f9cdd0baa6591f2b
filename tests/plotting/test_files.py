"""Pictures as files: of the format that their name says, and always the same bytes."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from PIL import Image

from skillctl.errors import StoreError, UsageError
from skillctl.plotting.formats import FORMATS, MOST_PROOFS, require_few, require_format, require_picture
from skillctl.plotting.skill import draw_skill
from skillctl.plotting.style import drawing, encode

DRAW = """
import sys
from pathlib import Path
from skillctl.store import read_skill
from skillctl.plotting.portrait import portrait_of
from skillctl.plotting.skill import draw_skill
from skillctl.plotting.style import encode
artifact = read_skill(Path(sys.argv[1]))
figure = draw_skill(portrait_of("reach", artifact.skill, artifact.demonstrations), "learned")
for form in ("png", "svg", "pdf"):
    Path(sys.argv[2], f"picture.{form}").write_bytes(encode(figure, form))
"""


@pytest.fixture(scope="module")
def drawn(portrait):
    figure = draw_skill(portrait(2, name="$x$ <b> 关"), "learned")
    return {form: encode(figure, form) for form in FORMATS}


def test_a_png_is_small_and_wide_enough_to_read(drawn):
    with Image.open(io.BytesIO(drawn["png"])) as image:
        assert image.format == "PNG"
        assert image.width == pytest.approx(7.4 * 150)
        assert "Software" not in image.info
    assert len(drawn["png"]) < 300_000


def test_an_svg_is_whole_and_asks_for_nothing(drawn):
    root = ET.fromstring(drawn["svg"])
    assert root.tag.endswith("svg")
    assert not [e for e in root.iter() if e.tag.endswith(("script", "foreignObject", "text"))]
    links = {v for e in root.iter() for k, v in e.attrib.items() if k.endswith("href")}
    assert links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert b"<dc:date>" not in drawn["svg"]


def test_a_pdf_is_whole_and_undated(drawn):
    assert drawn["pdf"].startswith(b"%PDF-")
    assert drawn["pdf"].rstrip().endswith(b"%%EOF")
    assert b"CreationDate" not in drawn["pdf"]


def test_the_same_skill_gives_the_same_bytes_in_another_process_at_home_elsewhere(tmp_path, library):
    """Whatever the order of hashes, the user's matplotlibrc, and the time."""
    written = []
    for seed, settings in (("1", ""), ("2", "font.size: 30\nsvg.fonttype: none\naxes.facecolor: red\n")):
        folder = tmp_path / seed
        folder.mkdir()
        (folder / "matplotlibrc").write_text(settings, encoding="utf-8")
        environment = {**os.environ, "PYTHONHASHSEED": seed, "MATPLOTLIBRC": str(folder)}
        command = [sys.executable, "-W", "error", "-c", DRAW, library / "reach" / "1.h5", folder]
        subprocess.run(list(map(str, command)), env=environment, check=True)
        written.append([(folder / f"picture.{form}").read_bytes() for form in FORMATS])
    assert written[0] == written[1]


def test_drawing_leaves_the_settings_of_the_user_alone():
    import matplotlib

    before = dict(matplotlib.rcParams)
    with drawing():
        assert matplotlib.rcParams["svg.hashsalt"] == "skillctl"
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("name", ["a.png", "a.PNG", "b.c.svg", "d.pdf"])
def test_the_suffix_says_the_format(name):
    assert require_format(Path(name)) == name[-3:].lower()


@pytest.mark.parametrize("name", ["a.jpg", "a", ".png", "a.png.txt", "a."])
def test_other_suffixes_are_refused_and_the_formats_listed(name):
    with pytest.raises(UsageError, match=r"\.png, \.svg, \.pdf"):
        require_format(Path(name))


def test_a_missing_directory_is_noticed_before_any_work(tmp_path):
    with pytest.raises(StoreError, match="no such directory"):
        require_picture(tmp_path / "missing" / "a.png")


def test_one_figure_holds_so_many_certificates():
    require_few(MOST_PROOFS)
    with pytest.raises(UsageError, match=str(MOST_PROOFS)):
        require_few(MOST_PROOFS + 1)
