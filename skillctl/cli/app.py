"""The command line: a registry of commands whose modules are imported when they are called."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from skillctl import errors
from skillctl.cli.errors import nearest_word, publications
from skillctl.cli.exit_codes import ExitCode, described
from skillctl.cli.output import Output
from skillctl.cli.parameters import expanded
from skillctl.memory import require_start

# Name → what `skillctl --help` says. The module and its function are the name with underscores.
COMMANDS = {
    "learn": "Learn a skill from demonstrations.",
    "merge": "Merge skills: all act together on one target.",
    "combine": "Combine skills: where it starts decides which acts.",
    "chain": "Chain skills: one acts after the other.",
    "adapt": "Find a skill for a task: alone, merged or combined.",
    "inspect": "Show what is in a skill.",
    "verify-stability": "Prove that skills reach their target.",
    "simulate": "Run a skill on a simulated arm.",
    "run": "Run a skill on a robot.",
    "quickstart": "See all of the above on an example, in about a minute.",
    "ls": "List the skills of the store.",
    "diff": "Compare two skills.",
    "log": "Show the history of a skill.",
    "tag": "Name a version, as in reach@release.",
    "untag": "Remove such a name.",
    "lock": "Write down which skills a pipeline uses.",
    "sign": "Sign a skill.",
    "verify-signature": "Say whether a key has signed a skill.",
    "rm": "Remove versions from the store.",
    "gc": "Remove all but the newest versions.",
    "export": "Write a skill for MATLAB, NumPy or as JSON.",
    "schema": "Print the JSON Schema of an output.",
    "completion": "Let the TAB key complete commands and skills.",
}

CONTEXT_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}

EPILOG = f"""\b
Example:
  skillctl quickstart
  skillctl learn recording.csv --name reach
  skillctl verify-stability reach

Results go to standard output, everything else to standard error.
Exit codes: {described()}."""

COMMON = "Every command"
PLACES = {"Arguments": 0, "Options": 2, COMMON: 3}  # of the sections of a help; others are between


class Grouped:
    """Adds the options that every command has, and shows options in groups."""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.params: list[Any]
        self.params.extend(common_options())  # `skillctl --json ls` as well as `skillctl ls --json`

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the help of the parameters, one section a group."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):  # type: ignore[attr-defined]
            if (record := parameter.get_help_record(ctx)) is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                sections.setdefault(getattr(parameter, "rich_help_panel", None) or kind, []).append(record)
        for title, records in sorted(sections.items(), key=lambda section: PLACES.get(section[0], 1)):
            with formatter.section(title):
                formatter.write_dl(records)


class Command(Grouped, TyperCommand):
    """A command."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the usage line, required arguments without braces."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]


class CommandGroup(Grouped, TyperGroup):
    """The group of all commands: lists them without importing them, and decides every exit code."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands, then the help of the options."""
        self.format_commands(ctx, formatter)
        super().format_options(ctx, formatter)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the registry."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a stub with a command's name and help only."""
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Import the module of the command that is called."""
        name = args[0]
        if name not in COMMANDS:
            hint = nearest_word(name, COMMANDS) or "'skillctl --help' lists the commands."
            raise errors.UsageError(f"No such command: {name}.", hint=hint)
        ctx.obj.command = f"skillctl {name}"
        if not {"-h", "--help"} & {*args}:
            require_start()
        return name, load_command(name), args[1:]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Print the help for a call without any command."""
        if not args and not ctx.resilient_parsing:
            print(ctx.get_help(), file=sys.stderr)
            raise typer.Exit(ExitCode.USAGE)
        return super().parse_args(ctx, args)

    def main(self, args: Sequence[str] | None = None, *_: Any, **__: Any) -> Any:
        """Run one command and exit. (Typer's own would turn errors into boxes and exit 1.)"""
        arguments = list(sys.argv[1:] if args is None else args)
        output, began = Output.for_arguments(arguments), time.monotonic()
        publications().clear()
        try:
            status = self._outcome(arguments, output)
            output.flush()
        except (Exception, KeyboardInterrupt) as error:
            sys.exit(output.fail(error))
        output.detail(f"done in {time.monotonic() - began:.2f} s, exit code {int(status)}")
        sys.exit(status)

    def _outcome(self, arguments: list[str], output: Output) -> int:
        try:
            with self.make_context("skillctl", arguments, obj=output) as context:
                self.invoke(context)
        except typer.Exit as stop:
            return int(stop.exit_code)
        return ExitCode.DONE


def common_options() -> list[TyperOption]:
    """Return the options that every command has; they set fields of the run's `Output`."""
    described = {
        ("as_json", "--json"): "Print one JSON document instead of a table.",
        ("quiet", "-q", "--quiet"): "Print the result only.",
        ("verbose", "-v", "--verbose"): "Say more about what is being done.",
        ("debug", "--debug"): "Show tracebacks.",
    }
    flag: dict[str, Any] = {"is_flag": True, "default": False, "expose_value": False}
    flag |= {"callback": _set_on_output, "rich_help_panel": COMMON}
    return [TyperOption(param_decls=list(names), help=text, **flag) for names, text in described.items()]


def _set_on_output(context: Any, parameter: Any, value: bool) -> None:
    if value:
        setattr(context.find_root().obj, parameter.name, True)


def load_command(name: str) -> Any:
    """Import the module of a command and return the command it declares."""
    function = name.replace("-", "_")
    module = import_module(f"skillctl.cli.{function}")
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    described = {"short_help": COMMANDS[name], "epilog": module.EXAMPLES}
    decorate = single.command(name, cls=Command, context_settings=CONTEXT_SETTINGS, **described)
    decorate(expanded(getattr(module, function)))
    return typer.main.get_command(single)


def group() -> Any:
    """Return the group of all commands."""
    return typer.main.get_command(app)


app = typer.Typer(
    cls=CommandGroup,
    add_completion=False,  # ours completes skills, too; see `skillctl completion`
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings=CONTEXT_SETTINGS,
    epilog=EPILOG,
)


@app.callback()
def skillctl(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    """Learn robot skills from demonstrations, make new ones from learned ones, prove them stable."""
