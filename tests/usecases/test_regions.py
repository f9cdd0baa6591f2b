"""What ``combine`` says of regions: of parts that their starts tell apart, and of parts that they do not."""

import numpy as np
import pytest

from skillctl.model.combined import CombinedSkill
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load


@pytest.fixture
def teach(tmp_path, run):
    """Learn a skill from straight reaches to the origin, a start each, and return its file."""

    def learned(name, starts):
        times, share = np.linspace(0, 2, 41), 0.5 * (1 + np.cos(np.linspace(0, np.pi, 41)))
        rows = ["demo,t,x,y"]
        for number, (x, y) in enumerate(starts):
            rows += [f"{number},{t},{s * x},{s * y}" for t, s in zip(times, share, strict=True)]
        data = tmp_path / f"{name}.csv"
        data.write_text("\n".join(rows))
        assert run("learn", data, "-o", tmp_path / f"{name}.h5", "--preset", "fast").exit_code == 0
        return tmp_path / f"{name}.h5"

    return learned


LEFT = [(-0.3, 0.01 * k) for k in range(6)]
RIGHT = [(0.3, 0.01 * k) for k in range(6)]


def test_parts_with_starts_of_their_own_keep_what_was_left_out(teach, run, tmp_path):
    both = tmp_path / "both.h5"
    result = run("combine", teach("left", LEFT), teach("right", RIGHT), "-o", both)
    assert (result.exit_code, result.stderr) == (0, "")
    skill = load(both)
    assert isinstance(skill, CombinedSkill)
    assert len(skill.regions) == 2
    assert skill.part_at([[-0.6, 0.3], [0.6, 0.3]]).tolist() == [0, 1]  # nobody began so far away
    shown = run("inspect", both).stdout
    assert "left-out starts in it" in shown
    assert shown.count("100%") == 2


def test_parts_taught_from_the_same_places_are_named(teach, run, tmp_path):
    first, second = teach("first", LEFT[::2]), teach("second", LEFT[1::2])
    report = combine([first, second], output=tmp_path / "both.h5")
    assert all(part.selected is not None and part.selected < 0.75 for part in report.coverage)
    result = run("combine", first, second, "--align", "-o", tmp_path / "aligned.h5")
    assert result.exit_code == 0
    assert (
        "part 1, left out in turn, start where another part acts, mostly part 2: both were taught"
        in result.stderr
    )
    assert "--calibrate" not in result.stderr  # no priors tell apart what starts at one place


def test_a_part_of_one_demonstration_has_no_share(teach, tmp_path):
    report = combine([teach("left", LEFT[:1]), teach("right", RIGHT)], output=tmp_path / "both.h5")
    assert [part.selected for part in report.coverage] == [None, 1.0]


def test_targets_that_hardly_differ_are_named(teach, run, tmp_path):
    left = teach("left", LEFT)
    moved = [(x - 0.0004, y) for x, y in RIGHT]
    right = tmp_path / "right.csv"
    rows = ["demo,t,x,y"]
    for number, (x, y) in enumerate(moved):
        rows += [
            f"{number},{t},{0.0004 + s * x},{s * y}"
            for t, s in zip(range(21), np.linspace(1, 0, 21), strict=True)
        ]
    right.write_text("\n".join(rows))
    assert run("learn", right, "-o", tmp_path / "right.h5", "--preset", "fast").exit_code == 0
    result = run("combine", left, tmp_path / "right.h5", "-o", tmp_path / "both.h5")
    assert "the targets of parts 1 and 2 are only 0.0004 m apart; --align makes them one" in result.stderr
    result = run("combine", left, tmp_path / "right.h5", "--align", "-o", tmp_path / "one.h5")
    assert "apart" not in result.stderr


def test_a_merged_skill_that_follows_none_of_its_parts_says_so(teach, run, tmp_path):
    # A straight way and an arc of the same ends: their mean is an arc half as high.
    left = teach("left", LEFT)
    alike = run("merge", left, left, "-o", tmp_path / "alike.h5")
    assert "follow none" not in alike.stderr
    turned = tmp_path / "turned.csv"
    rows, times = ["demo,t,x,y"], np.linspace(0, 2, 41)
    for number in range(6):
        for t, angle in zip(times, np.linspace(np.pi, 0, 41), strict=True):
            rows.append(f"{number},{t},{0.15 * (np.cos(angle) - 1)},{0.3 * np.sin(angle) + 0.001 * number}")
    turned.write_text("\n".join(rows))
    assert run("learn", turned, "-o", tmp_path / "turned.h5", "--preset", "fast").exit_code == 0
    different = run("merge", left, tmp_path / "turned.h5", "-o", tmp_path / "different.h5")
    assert different.exit_code == 0
    assert "follow none of the parts: from the starts of their demonstrations" in different.stderr
