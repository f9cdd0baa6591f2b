"""Short runs of the commands in tests/torture; the long ones are for a person to start."""

import re
import subprocess
import sys
from pathlib import Path

TORTURE = Path(__file__).parents[1] / "torture"


def command(name: str, *arguments: object, folder: Path) -> str:
    run = subprocess.run(
        [sys.executable, TORTURE / f"{name}.py", *map(str, arguments)],
        cwd=folder, capture_output=True, text=True, check=False, timeout=280,
    )  # fmt: skip
    assert (run.returncode, run.stderr) == (0, ""), run.stdout[-2000:] + run.stderr[-4000:]
    return run.stdout


def test_no_spoiled_artifact_crashes_hangs_or_is_silently_read_as_another(tmp_path):
    said = command("fuzz", "--count", 3200, "--seed", 1, "--save", tmp_path, folder=tmp_path)
    row = re.search(r"^all +(\d+) +(\d+) +(\d+) +(\d+)$", said, re.MULTILINE)
    refused, same, another, unchanged = map(int, row.groups())
    assert refused + same + another > 2900
    assert another > 50  # sealed again: what lies behind the seal was reached
    assert unchanged < 300
    assert "0 broke a rule" in said
    assert list(tmp_path.iterdir()) == []


def test_whoever_is_killed_or_interrupted_leaves_a_whole_store(tmp_path):
    arguments = (
        "--count", 12, "--stride", 23, "--commands", 2, "--writers", 4, "--each", 4, "--seconds", 3,
    )  # fmt: skip
    said = command("kill", *arguments, folder=tmp_path).splitlines()
    assert [line.split(":")[0] for line in said] == [
        "killed at random", "killed before a line", "interrupted before a line", "terminated before a line",
        "commands stopped", "a fault at a call", "beside each other", "writers at once",
    ]  # fmt: skip
    assert "BROKE" not in "".join(said)
    for line in said[1:3]:  # each operation was stopped at several places
        assert all(int(n) >= 3 for n in re.findall(r"(?:publish|tag|untag|remove)\w* (\d+)", line))


def test_the_reader_decides_definiteness_exactly(tmp_path):
    said = command("definite", "--count", 150, folder=tmp_path)
    for verdict in ("accepted", "refused"):
        assert int(re.search(rf"should be {verdict}, was {verdict}: (\d+)", said)[1]) > 30
    assert "\n0 broke a rule" in said


def test_scenarios_with_extreme_numbers_end(tmp_path):
    skill = Path(__file__).parents[2] / "skills" / "top-centre" / "1.h5"
    assert "\n0 broke a rule" in command("scenarios", skill, "--stride", 73, folder=tmp_path)


def test_what_random_commands_say_is_true_whatever_happens_to_them(tmp_path):
    said = command("soak", "--seconds", 10, "--users", 4, "--pause", 5, folder=tmp_path)
    counts = {what: int(n) for what, n in re.findall(r"^(.+): (\d+)$", said, re.MULTILINE)}
    assert counts["looks at the store"] >= 1
    assert counts["exit code 0"] > 0
    assert counts["versions read"] > 0
