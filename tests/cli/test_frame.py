"""The contract that holds for every command: streams, exit codes, words, before any command runs."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from skillctl import errors
from skillctl.cli.app import COMMANDS, load_command
from skillctl.cli.errors import describe, nearest_word
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output


def test_version_is_one_line(shell):
    result = shell("--version")
    assert (result.returncode, result.stdout, result.stderr) == (0, "skillctl 0.2.0.dev0\n", "")


def test_no_command_shows_the_help_on_standard_error(shell):
    result = shell()
    assert (result.returncode, result.stdout) == (2, "")
    assert all(name in result.stderr for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_has_an_example_that_names_the_command(run, name):
    result = run(name, "--help")
    assert (result.exit_code, result.stderr) == (0, "")
    assert f"Example:\n    skillctl {name}" in result.stdout
    assert "--json" in result.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_no_line_of_an_example_is_broken_at_80_columns(run, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    lines = run(name, "--help").stdout.split("\n")
    first = next(i for i, line in enumerate(lines) if line.strip().startswith("Example"))
    assert max(map(len, lines)) <= 80
    assert all(line.startswith("  ") for line in lines[first:] if line.strip())


def test_the_main_help_has_an_example(run):
    assert "Example:\n    skillctl quickstart" in run("--help").stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_short_help_fits_in_the_list_of_commands(run, name):
    assert COMMANDS[name] in run("--help").stdout


@pytest.mark.parametrize(
    ("arguments", "message", "hint"),
    [
        (["lern"], "No such command: lern.", "Did you mean learn?"),
        (["zzzzzz"], "No such command: zzzzzz.", "'skillctl --help' lists the commands."),
        (["learn", "--nam", "x", "d.csv"], "No such option: --nam.", "Did you mean --name?"),
        (["merge", "--gate", "sum", "a", "b"], "Invalid value for '--gate'", "'skillctl merge --help'"),
        (["inspect"], "Missing argument 'SKILL'.", "'skillctl inspect --help'"),
        (["merge", "a", "b", "--target", "1,x"], "'1,x' is not a list of numbers", "'skillctl merge --help'"),
        (["learn", "d.csv", "--demos", "5-2"], "'5-2' is not a list of numbers", "'skillctl learn --help'"),
        (["learn", "d.csv", "--columns", "x,,z"], "'x,,z' is not a list of names", "'skillctl learn --help'"),
        (["learn", "d.csv", "--name"], "Option '--name' requires an argument.", "'skillctl learn --help'"),
    ],
)
def test_usage_errors_have_one_form(run, arguments, message, hint):
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    first, second = result.stderr.splitlines()
    assert first.startswith("error: ")
    assert message in first
    assert second.startswith("hint: ")
    assert hint in second


@pytest.mark.parametrize("arguments", [["--json", "lern"], ["lern", "--json"], ["ls", "--json", "--bogus"]])
def test_usage_errors_as_json_are_one_document_on_standard_error(run, arguments):
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    document = json.loads(result.stderr)
    assert list(document) == ["schema_version", "code", "message", "hint"]
    assert document["code"] == 2


def test_json_after_a_double_dash_is_an_argument(run):
    result = run("inspect", "--", "--json")
    assert result.stderr.startswith("error: ")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UsageError("x"), 2),
        (errors.NotFoundError("x"), 4),
        (errors.InputDataError("x"), 5),
        (errors.InvalidModelError("x"), 5),
        (errors.FitError("x"), 6),
        (errors.ArtifactError("x"), 7),
        (errors.StoreError("x"), 8),
        (errors.GoalNotReachedError("x"), 1),
        (PermissionError(13, "Permission denied", "/x"), 8),
        (BrokenPipeError(), 141),
        (KeyboardInterrupt(), 130),
        (ZeroDivisionError("division by zero"), 70),
        (MemoryError(), 8),
    ],
)
def test_every_error_has_its_exit_code(error, code):
    assert describe(error).code == code


def test_every_deliberate_error_has_a_code_of_its_own():
    deliberate = errors.SkillctlError.__subclasses__()
    assert all(describe(kind("x")).code != ExitCode.INTERNAL for kind in deliberate)


def test_control_characters_are_never_echoed_raw(run):
    result = run("inspect", "a\x1b[2Jb\u202e\n")
    assert result.exit_code == 2
    assert "x1b[2Jb" in result.stderr
    assert "\x1b" not in result.stderr
    assert "\u202e" not in result.stderr


def test_suggestions_are_near_or_absent():
    assert nearest_word("simulat", COMMANDS) == "Did you mean simulate?"
    assert nearest_word("xylophone", COMMANDS) == ""


class _Broken:
    """Stands in for a command with a bug."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def __call__(self, *_: object) -> None:
        raise self.error


@pytest.fixture
def broken(monkeypatch, run):
    """Run a command whose module cannot be imported because of the given error."""

    def call(error: BaseException, *options: str):
        monkeypatch.setattr("skillctl.cli.app.load_command", _Broken(error))
        return run(*options, "ls")

    return call


def test_a_bug_exits_70_without_a_traceback(broken):
    result = broken(ZeroDivisionError("division by zero"))
    assert (result.exit_code, result.stdout) == (70, "")
    assert result.stderr.startswith("error: internal error (ZeroDivisionError: division by zero).\nhint: ")
    assert "--debug" in result.stderr


def test_debug_shows_the_traceback_of_a_bug(broken):
    result = broken(ZeroDivisionError("division by zero"), "--debug")
    assert result.exit_code == 70
    assert "Traceback (most recent call last)" in result.stderr


def test_ctrl_c_exits_130(broken):
    result = broken(KeyboardInterrupt())
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "error: interrupted.\n")


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_says_so_and_leaves_nothing_behind(tmp_path, curve_files, sent, code):
    command = [sys.executable, "-m", "skillctl", "learn", *map(str, curve_files), "-o", "a.h5", "-v"]
    with subprocess.Popen(
        [*command, "--preset", "quality", "--components", "auto"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr.readline().startswith("learning: ")  # it is in the middle of it
        process.send_signal(sent)
        printed, said = process.communicate(timeout=30)
    assert (process.returncode, printed) == (code, "")
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def children(parent: int) -> list[Path]:
    """Return the folders in /proc of the processes that a process has started."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it ended meanwhile
            if status.read_text().rpartition(")")[2].split()[1] == str(parent):
                found.append(status.parent)
    return found


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_batch_ends_its_workers_and_leaves_nothing_behind(tmp_path, curve_files, sent, code):
    files = json.dumps([str(path) for path in curve_files])
    skills = "".join(f'[[skills]]\noutput = "{n}.h5"\nseed = {n}\ndata = {files}\n' for n in range(3))
    (manifest := tmp_path / "many.toml").write_text(f'[options]\npreset = "quality"\n{skills}')
    command = [sys.executable, "-m", "skillctl", "learn", "--batch", str(manifest), "--jobs", "2", "-v"]
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, **streams) as process:
        while len(pids := children(process.pid)) < 2:
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(sent)
        printed, said = process.communicate(timeout=60)
    assert (process.returncode, printed) == (code, "")
    assert "Traceback" not in said
    while any(pid.exists() for pid in pids):  # they are being removed; the test's time limit ends this
        time.sleep(0.05)
    assert list(tmp_path.iterdir()) == [manifest]


SOLVING = """
import signal
import numpy as np
from skillctl import __main__ as program

program.GRACE = 0.1
signal.signal(signal.SIGTERM, program._terminate)
program._end_in_time()
matrix = np.random.default_rng(0).standard_normal((3000, 3000))
while True:
    try:
        print("solving", flush=True)
        np.linalg.solve(matrix, matrix[0])
    except KeyboardInterrupt:  # it came before, or after
        pass
"""


@pytest.mark.parametrize(
    ("sent", "code", "said"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")]
)
def test_not_even_a_program_that_does_not_listen_is_waited_for(sent, code, said):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", SOLVING], env=environment, **streams) as process:
        assert process.stdout.readline() == "solving\n"
        process.send_signal(getattr(signal, sent))
        assert process.communicate()[1] == f"error: {said}.\n"
    assert process.returncode == code


def test_a_full_disk_under_standard_output_is_not_success(shell):
    with open("/dev/full", "w") as full:  # noqa: PTH123 - a device, not a path to manage
        for arguments in (["--version"], ["--help"], ["ls"]):
            result = shell(*arguments, capture_output=False, stdout=full, stderr=subprocess.PIPE)
            assert result.returncode == 8, arguments
            assert result.stderr.count("\n") <= 2
            assert "No space left on device" in result.stderr
            assert "Exception ignored" not in result.stderr


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["ls"]])
def test_a_closed_pipe_exits_141_in_silence(shell, arguments):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        result = shell(*arguments, capture_output=False, stdout=writer, stderr=subprocess.PIPE)
    finally:
        os.close(writer)
    assert (result.returncode, result.stderr) == (141, "")


def test_a_closed_standard_output_is_an_error(tmp_path):
    command = ["bash", "-c", f"{sys.executable} -m skillctl ls >&-"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 8
    assert "standard output is closed" in result.stderr


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("verify-stability none.h5 --json", 4),
        ("verify-stability none.h5", 4),
        ("learn none.csv -o a.h5 --debug", 4),
        ("learn motion.csv -o a.h5 --verbose --preset fast", 0),
        ("--bogus", 2),
        ("ls --store .", 0),
    ],
)
@pytest.mark.parametrize("closed", ["2>&-", "2>&- <&-"])
def test_a_closed_standard_error_changes_nothing_else(tmp_path, curve_files, command, code, closed):
    shutil.copy(curve_files[0], tmp_path / "motion.csv")
    heard = ["bash", "-c", f"{sys.executable} -m skillctl {command} 2>/dev/null"]
    result = subprocess.run(heard, cwd=tmp_path, capture_output=True, check=False)
    assert result.returncode == code
    (tmp_path / "a.h5").unlink(missing_ok=True)
    unheard = ["bash", "-c", f"{sys.executable} -m skillctl {command} {closed}"]
    again = subprocess.run(unheard, cwd=tmp_path, capture_output=True, check=False)
    assert (again.returncode, again.stdout) == (code, result.stdout)


def test_common_options_work_before_and_after_the_command(run, tmp_path):
    before = run("--json", "ls", "--store", tmp_path)
    after = run("ls", "--store", tmp_path, "--json")
    assert before.exit_code == after.exit_code == 0
    assert json.loads(before.stdout) == json.loads(after.stdout)


def test_notes_are_for_people_who_did_not_ask_for_quiet_or_json(capsys):
    for output in (Output(quiet=True), Output(as_json=True)):
        output.note("hello")
    assert capsys.readouterr().err == ""
    Output().note("hello")
    Output().detail("not asked for")
    Output(verbose=True).detail("asked for")
    assert capsys.readouterr().err == "hello\nasked for\n"


def test_a_command_that_is_announced_can_be_pasted(monkeypatch, capsys):
    command = "skillctl merge bottom-right top-centre --target 0.63,-0.28,0.76 --name top-right"
    Output().announce(command)
    assert capsys.readouterr().err == f"$ {command}\n"
    monkeypatch.setattr("skillctl.cli.output.is_terminal", lambda _: True)
    monkeypatch.setenv("COLUMNS", "40")
    Output().announce(command)
    lines = capsys.readouterr().err.removeprefix("$ ").splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= 40
    typed = ["bash", "-c", "skillctl() { printf '%s\n' skillctl \"$@\"; }\n" + "\n".join(lines)]
    heard = subprocess.run(typed, capture_output=True, text=True, check=True)
    assert heard.stdout.split() == command.split()


def test_warnings_are_for_everyone_but_readers_of_json_who_find_them_in_the_document(capsys):
    Output(as_json=True).warning("hello")
    assert capsys.readouterr().err == ""
    Output(quiet=True).warning("hello")
    assert capsys.readouterr().err == "warning: hello\n"


@pytest.mark.parametrize("environment", [{"TERM": "dumb"}, {"CI": "true", "TERM": "xterm"}])
def test_dumb_terminals_and_ci_get_plain_lines(shell, environment):
    assert "\x1b" not in _on_a_terminal(shell, environment)


def test_no_color_keeps_the_table_and_drops_the_colour(shell):
    text = _on_a_terminal(shell, {"TERM": "xterm-256color", "NO_COLOR": "1"})
    assert "\x1b[3" not in text


def _on_a_terminal(shell, environment: dict[str, str]) -> str:
    main, terminal = pty.openpty()
    try:
        result = shell("ls", capture_output=False, stdout=terminal, env={**os.environ, **environment})
        assert result.returncode == 0
        return os.read(main, 65536).decode()
    finally:
        os.close(main)
        os.close(terminal)


def test_every_command_of_the_registry_can_be_loaded():
    assert [load_command(name).name for name in COMMANDS] == list(COMMANDS)


STOPPED_WHILE_LOADING = """
import os, sys
from skillctl.__main__ import main
module, number = sys.argv[1], int(sys.argv[2])
class Stop:
    def find_spec(self, name, *_):
        if name == module:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), number)
sys.meta_path.insert(0, Stop())
sys.argv = ["skillctl", "ls"]
main()
"""


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_result_that_fits_in_part_is_no_success(tmp_path, library, unbuffered):
    """Python without buffers does not see that the disk took a part only."""
    limited = f"ulimit -f 1; exec {sys.executable} -m skillctl inspect plain --json > {tmp_path / 'out'}"
    surroundings = {**os.environ, "SKILLCTL_STORE": str(library), "PYTHONUNBUFFERED": unbuffered}
    command = ["bash", "-c", limited]
    result = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=False)
    assert result.returncode == 8
    assert json.loads(result.stderr)["message"] == "standard output cannot be written: File too large."


@pytest.mark.parametrize(("number", "code", "word"), [(2, 130, "interrupted"), (15, 143, "terminated")])
def test_a_signal_while_an_object_is_removed_is_not_lost(tmp_path, number, code, word):
    """Python ignores what is raised then, and prints a traceback."""
    removing = f"""
import os, sys, time
from skillctl import __main__
class Removed:
    def __del__(self):
        os.kill(os.getpid(), {number})
def run():
    Removed()
    time.sleep(30)
__main__._run = run
sys.argv = ["skillctl", "ls", "--json"]
__main__.main()
"""
    command = [sys.executable, "-c", removing]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (code, "")
    told = json.loads(result.stderr)
    assert (told["code"], told["message"]) == (code, f"{word}.")


@pytest.mark.parametrize(("number", "code", "word"), [(2, 130, "interrupted"), (15, 143, "terminated")])
@pytest.mark.parametrize("module", ["skillctl.cli.app", "skillctl.usecases.ls"])
def test_a_signal_while_modules_are_loaded_is_no_verdict(tmp_path, module, number, code, word):
    command = [sys.executable, "-c", STOPPED_WHILE_LOADING, module, str(number)]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (code, "", f"error: {word}.\n")
