"""TAB, pressed in real shells: what is completed, what it costs, and that nothing is broken by it."""

from __future__ import annotations

import json
import os
import pty
import resource
import select
import shlex
import shutil
import statistics
import subprocess
import sys
import time

import pytest

from skillctl.cli.app import COMMANDS, load_command
from skillctl.cli.candidates import VALUES, Answer, answer_to, split

SHELLS = {
    "bash": ["bash", "--norc", "--noprofile", "-i"],
    "zsh": ["zsh", "-f", "-i"],
}
# Completes as skillctl does, and instead of doing anything else shows the words it was given.
STANDIN = """#!{python}
import sys
from pathlib import Path
from skillctl.__main__ import main
if sys.argv[1:2] in (["__complete"], ["completion"]):
    main()
    with Path("{log}").open("a") as log:
        log.write("answered\\n")
else:
    print("GOT", *(f"<{{word}}>" for word in sys.argv[1:]), "END")
"""


def completed(*words):
    """Return what can stand in place of the last word."""
    return [word for word, _ in answer_to(words).words]


@pytest.fixture
def shop(library, tmp_path, monkeypatch):
    """A directory with files, a store with two versions and an alias, and a stand-in for the program."""
    (folder := tmp_path / "shop").mkdir()
    shutil.copytree(library, folder / "skills")
    shutil.copy(folder / "skills" / "curve" / "1.h5", folder / "skills" / "curve" / "2.h5")
    (folder / "skills" / "curve" / "refs.toml").write_text("[aliases]\nrelease = 1\n")
    (folder / "only.csv").write_text("")
    (folder / "my own.csv").write_text("")
    (folder / "zeta.h5").write_text("")
    (folder / "$(touch evil).h5").write_text("")
    (program := folder / "bin" / "skillctl").parent.mkdir()
    program.write_text(STANDIN.format(python=sys.executable, log=folder / "answers"))
    program.chmod(0o755)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("HOME", str(tmp_path))
    return folder


class Terminal:
    """An interactive shell in the shop, typed at."""

    def __init__(self, shell, shop):
        self.shop, self.screen = shop, ""
        self.master, slave = pty.openpty()
        environment = {**os.environ, "TERM": "xterm", "PS1": "$ "}
        self.process = subprocess.Popen(
            SHELLS[shell], stdin=slave, stdout=slave, stderr=slave, cwd=shop, env=environment,
            start_new_session=True,
        )  # fmt: skip
        os.close(slave)

    def type(self, text):
        os.write(self.master, text.encode())

    def press_tab(self, seconds=30.0):
        """Press TAB and wait for the answer: a shell may drop what is typed before."""
        before = answers(self.shop)
        self.type("\t")
        deadline = time.monotonic() + seconds
        while answers(self.shop) == before:
            assert time.monotonic() < deadline, f"TAB has no effect:\n{self.screen}"
            time.sleep(0.01)
        time.sleep(0.15)  # the shell still has to read it

    def until(self, mark, seconds=30.0):
        """Return what is on the screen when a mark appears."""
        deadline = time.monotonic() + seconds
        while mark not in self.screen:
            ready, _, _ = select.select([self.master], [], [], max(deadline - time.monotonic(), 0))
            assert ready, f"{mark!r} does not appear:\n{self.screen}"
            self.screen += os.read(self.master, 65536).decode(errors="replace")
        shown, self.screen = self.screen, ""
        return shown

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.master)


def answers(shop):
    """Return how often the stand-in completed something."""
    log = shop / "answers"
    return log.read_text().count("\n") if log.exists() else 0


TYPED = {
    "skillctl insp\t": "<inspect>",
    "skillctl inspect ree\b\bea\t": "<inspect> <reach>",
    "skillctl inspect curve@rel\t": "<inspect> <curve@release>",
    "skillctl inspect hook@\b@l\t": "<inspect> <hook@latest>",
    "skillctl verify-stability plain@\t1\t": "<verify-stability> <plain@1>",
    "skillctl learn --metric=\tl\t": "<learn> <--metric=learned>",
    "skillctl inspect hook@1\t": "<inspect> <hook@1>",
    "skillctl merge curve@2 ho\t": "<merge> <curve@2> <hook>",
    "skillctl simulate reach --pict\t": "<simulate> <reach> <--picture>",
    "skillctl learn --preset qu\t": "<learn> <--preset> <quality>",
    "skillctl learn --preset=qu\t": "<learn> <--preset=quality>",
    "skillctl learn onl\t": "<learn> <only.csv>",
    "skillctl learn --output=onl\t": "<learn> <--output=only.csv>",
    "skillctl learn 'my own.csv' --preset fa\t": "<learn> <my own.csv> <--preset> <fast>",
    "skillctl inspect skills/cur\t1.h\t": "<inspect> <skills/curve/1.h5>",
    "skillctl inspect --store skills re\t": "<inspect> <--store> <skills> <reach>",
    "skillctl tag curve@2 rel\t": "<tag> <curve@2> <release>",
    "skillctl inspect zet\t": "<inspect> <zeta.h5>",
}


@pytest.mark.parametrize("shell", SHELLS)
def test_a_real_shell_completes(shell, shop):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    terminal = Terminal(shell, shop)
    try:
        terminal.type(f"eval \"$(skillctl completion {shell})\"; echo re''ady\n")
        terminal.until("ready")
        for keys, expected in TYPED.items():
            for stroke in keys.split("\t")[:-1]:
                terminal.type(stroke)
                terminal.press_tab()
            terminal.type("\n")
            shown = terminal.until("END")
            assert f"GOT {expected} END" in shown, f"{keys!r}:\n{shown}"
    finally:
        terminal.close()
    assert not (shop / "evil").exists()


IN_FISH = {
    "skillctl insp": ["inspect"],
    "skillctl inspect --lin": ["--lineage"],
    "skillctl inspect curve@r": ["curve@release"],
    "skillctl inspect zet": ["zeta.h5"],
    "skillctl learn --preset=": ["--preset=fast", "--preset=default", "--preset=quality"],
    "skillctl learn onl": ["only.csv"],
    "skillctl learn --output=onl": ["--output=only.csv"],
    "skillctl learn 'my own.csv' --units r": ["rad"],
    "skillctl ls --store skills h": ["hook"],
    "skillctl inspect skills/curve/1": ["skills/curve/1.h5"],
    "skillctl learn --seed ": [],
}


def test_fish_completes(shop):
    if shutil.which("fish") is None:
        pytest.skip("fish is not installed")
    lines = [f"complete -C {shlex.quote(line)}; echo MARK" for line in IN_FISH]
    script = "\n".join(["skillctl completion fish | source", *lines])
    result = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, check=True)
    shown = result.stdout.split("MARK\n")
    for line, expected, found in zip(IN_FISH, IN_FISH.values(), shown, strict=False):
        assert sorted(f.split("\t")[0] for f in found.splitlines()) == sorted(expected), line
    assert not (shop / "evil").exists()


def test_what_is_completed_depends_on_what_is_typed(shop):
    assert completed("") == list(COMMANDS)
    assert completed("--v") == ["--version", "--verbose"]
    assert completed("inspect", "") == ["curve", "hook", "plain", "reach", "zeta.h5", "bin/", "skills/"]
    assert completed("inspect", "curve", "") == []  # one is enough
    assert completed("inspect", "curve@") == ["curve@latest", "curve@release", "curve@2", "curve@1"]
    assert completed("merge", "curve", "-o", "x.h5", "h") == ["hook"]
    assert completed("merge", "--gate", "e") == ["experts"]
    assert completed("run", "curve", "--driver", "ud") == ["udp"]
    assert completed("learn", "--components", "") == ["auto"]
    assert completed("verify-stability", "--report", "j") == ["junit=", "json="]
    assert completed("diff", "curve", "re") == ["reach"]
    assert completed("untag", "curve", "") == ["release"]
    assert completed("ls", "--", "c") == ["curve"]
    assert "--lineage" not in completed("inspect", "--lineage", "--l")
    assert "--report" in completed("verify-stability", "--report", "json=a", "--rep")
    assert answer_to(["ls", "--store", ""]).kind == "directories"
    assert answer_to(["verify-stability", "--report", "junit="]) == Answer((), "files", 6)
    assert answer_to(["learn", "--depfile=a"]) == Answer((), "files", 10)
    assert answer_to(["nonsense", ""]) == Answer()


def test_skills_come_from_the_store_that_is_named(shop, tmp_path):
    assert completed("inspect", "--store", str(tmp_path), "c") == []
    assert completed("inspect", f"--store={shop}/skills", "cur") == ["curve"]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_word_for_a_value_is_understood(name):
    """Text is completed, or is of a kind of which nobody can know what is meant."""
    for parameter in load_command(name).params:
        metavar = (parameter.metavar or "").strip("[].")
        if type(parameter.type).__name__ == "StringParamType":
            known = metavar in {*VALUES, "TEXT", "FRAME", "TOPIC"} or {"|", ","} & set(metavar)
            assert known, f"{parameter.name}: add {metavar} to VALUES"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("skillctl", ["skillctl"]),
        ("skillctl ", ["skillctl", ""]),
        ("a 'b c' d", ["a", "b c", "d"]),
        ("a 'b c", ["a", "b c"]),
        ("a b\\ c", ["a", "b c"]),
        ("a #b", ["a", "#b"]),
        ("", [""]),
    ],
)
def test_a_line_is_split_as_by_a_shell(line, words):
    assert split(line) == words


@pytest.mark.parametrize(
    "request_words", [[], ["line"], ["line", "'"], ["words"], ["words", "inspect", "A@"]]
)
def test_no_request_ends_in_an_error(shell, library, request_words):
    result = shell("__complete", *request_words, env={**os.environ, "SKILLCTL_STORE": str(library)})
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith("words 0\n")


def test_tab_imports_nothing_heavy(library, tmp_path):
    code = """
import sys
from skillctl.cli import candidates
candidates.main(["words", *sys.argv[1:]])
print(*{name.partition(".")[0] for name in sys.modules}, file=sys.stderr)
"""
    for words in (["ins"], ["merge", "--store", library, "c"], ["inspect", "--store", library, "curve@"]):
        command = [sys.executable, "-c", code, *map(str, words)]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert result.stdout.count("\n") > 1
        assert set(result.stderr.split()).isdisjoint({"numpy", "h5py", "pydantic", "scipy", "rich"})


def test_tab_answers_within_a_quarter_of_a_second(library, tmp_path):
    def cost():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [
            sys.executable,
            "-m",
            "skillctl",
            "__complete",
            "words",
            "merge",
            "--store",
            str(library),
            "c",
        ]
        subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert statistics.median(cost() for _ in range(3)) < 0.25  # what feels immediate


@pytest.mark.parametrize("shell_name", ["bash", "zsh", "fish"])
def test_installing_twice_is_installing_once(shell, tmp_path, shell_name):
    environment = {"HOME": str(tmp_path), "PATH": os.environ["PATH"], "SHELL": f"/bin/{shell_name}"}
    (startup := tmp_path / f".{shell_name}rc").write_text("# mine\n")
    for _ in range(2):
        result = shell("completion", "--install", "--json", env=environment)
        assert result.returncode == 0, result.stderr
        report = json.loads(result.stdout)
    assert (tmp_path / report["path"]).read_text() == report["script"]
    if shell_name == "fish":
        assert report["startup"] is None
        assert report["path"].endswith(".config/fish/completions/skillctl.fish")
    else:
        assert report["startup"] == str(startup)
        assert startup.read_text().splitlines()[0] == "# mine"
        assert len(startup.read_text().splitlines()) == 2


def test_bash_reads_what_was_installed(shell, tmp_path):
    environment = {"HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    assert shell("completion", "bash", "--install", env=environment).returncode == 0
    command = ["bash", "-c", ". ~/.bashrc; complete -p skillctl"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert result.stdout == "complete -F _skillctl skillctl\n"


def test_an_unknown_shell_is_refused_in_words(shell):
    result = shell("completion", env={**os.environ, "SHELL": "/bin/tcsh"})
    assert result.returncode == 2
    assert "tcsh" in result.stderr
