"""``skillctl completion``."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, cast, get_args

import typer

from skillctl.cli import render, words
from skillctl.cli.output import Output
from skillctl.errors import UsageError
from skillctl.opening import open_regular

EXAMPLES = """\b
Example:
  skillctl completion --install
  skillctl completion bash > skillctl.bash
  eval "$(skillctl completion zsh)"

Completed are commands, options, their choices, skills, versions (reach@3), aliases and files."""

Shell: TypeAlias = Literal["bash", "zsh", "fish"]


@dataclass(frozen=True)
class CompletionReport:
    """How a shell completes what is typed.

    Attributes:
        shell: ``bash``, ``zsh`` or ``fish``.
        script: What the shell has to read.
        path: Where it was installed; None if it was only shown.
        startup: The file that reads it when a shell starts; None where the shell finds it by itself.
    """

    shell: Shell
    script: str
    path: Path | None = None
    startup: Path | None = None


def completion(
    context: typer.Context,
    shell: Annotated[Shell | None, typer.Argument(help="Default: the shell in $SHELL.")] = None,
    install: Annotated[
        bool, typer.Option("--install", help="Install the script for new shells instead of printing it.")
    ] = False,
) -> None:
    """Complete commands, options, skills and files with the TAB key.

    The script that a shell needs for this is printed. With --install, it is written into your data folder and
    one line that reads it is added to ~/.bashrc or ~/.zshrc; fish finds it by itself.
    """
    output: Output = context.obj
    shell = shell or _login_shell()
    script = (Path(__file__).parent / "shells" / f"skillctl.{shell}").read_text(encoding="utf-8")
    report = CompletionReport(shell, script, *(_installed(shell, script) if install else ()))
    if not (install or output.as_json):
        output.verbatim(script)
        return
    places = (("script", report.path), ("read by", report.startup))
    facts = [("shell", shell), *((name, words.near(path)) for name, path in places if path)]
    hint = "Open a new shell, type skillctl and a space, and press TAB twice."
    output.result(report, lambda: [render.Facts(tuple(facts)), hint])


def _installed(shell: Shell, script: str) -> tuple[Path, Path | None]:
    """Write the script where the shell finds it, and return that file and the one that reads it."""
    from skillctl.store import write_file

    home = Path.home()
    if shell == "fish":
        folder = Path(os.environ.get("XDG_CONFIG_HOME") or home / ".config") / "fish" / "completions"
    else:
        folder = Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share") / "skillctl"
    folder.mkdir(parents=True, exist_ok=True)
    write_file(path := folder / f"skillctl.{shell}", script.encode())
    if shell == "fish":
        return path, None
    zsh_home = Path(os.environ.get("ZDOTDIR") or home)
    startup = zsh_home / ".zshrc" if shell == "zsh" else home / ".bashrc"
    line = f"[ -r '{path}' ] && . '{path}'  # completion of skillctl\n"
    with suppress(FileNotFoundError), open_regular(startup) as before:
        if line.encode() in before.read():
            return path, startup
    with startup.open("a", encoding="utf-8") as file:  # in place: it may be a link to where it is kept
        file.write(line)
    return path, startup


def _login_shell() -> Shell:
    name = Path(os.environ.get("SHELL", "")).name
    if name not in get_args(Shell):
        raise UsageError(
            f"$SHELL is {name or 'not set'}; completion exists for {', '.join(get_args(Shell))}.",
            hint="Name the shell, as in `skillctl completion bash`.",
        )
    return cast(Shell, name)
