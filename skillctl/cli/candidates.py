"""What can follow the words typed so far: the answer to a shell in which TAB was pressed.

Nothing heavy may be imported here: a key has to answer at once.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from skillctl.cli.app import COMMANDS, app_options, load_command
from skillctl.errors import SkillctlError, printable
from skillctl.store import Registry, locate_store

# Words that mean the same in every shell; files of other names are completed once ./ is typed.
PLAIN = re.compile(r"[\w.,+-]+")

Kind: TypeAlias = Literal["words", "files", "directories"]


@dataclass(frozen=True)
class Answer:
    """What a shell is told.

    Attributes:
        words: Candidates with a few words of help, which may be empty. They complete the whole word.
        kind: What else fits, and is left to the shell: nothing, files, or directories.
        settled: How many characters of the word come before the name of that file, as in ``--output=``.
    """

    words: tuple[tuple[str, str], ...] = ()
    kind: Kind = "words"
    settled: int = 0

    def starting_with(self, prefix: str) -> Answer:
        """Return the answer for a word of which ``prefix`` is typed."""
        return Answer(tuple(pair for pair in self.words if pair[0].startswith(prefix)), self.kind)

    def after(self, typed: str) -> Answer:
        """Return the answer for a value that is typed directly behind its option."""
        words = tuple((f"{typed}{word}", text) for word, text in self.words)
        return Answer(words, self.kind, len(typed) + self.settled)

    def __str__(self) -> str:
        lines = [f"{word}\t{' '.join(printable(text).split())}".rstrip() for word, text in self.words]
        return "".join(f"{line}\n" for line in [f"{self.kind} {self.settled}", *lines])


def main(arguments: Sequence[str]) -> None:
    """Print the answer to a shell's request; a request that cannot be answered gets an empty one.

    Args:
        arguments: ``line`` and the command line up to the cursor, or ``words`` and what follows the program.
    """
    form, *rest = arguments or ["words"]
    words = split(rest[0])[1:] if form == "line" and rest else rest
    try:
        answer = answer_to(words)
    except (SkillctlError, OSError):
        answer = Answer()
    sys.stdout.write(str(answer))


def split(line: str) -> list[str]:
    """Return the words of a line as a shell would, the last one unfinished and maybe empty."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=False)
    lexer.whitespace_split, lexer.commenters = True, ""
    words: list[str] = []
    try:
        words.extend(lexer)
    except ValueError:  # a quotation that is not closed yet
        return [*words, lexer.token]
    return [*words, ""] if not line or line[-1].isspace() else words


def answer_to(words: Sequence[str]) -> Answer:
    """Return what can stand in place of the last word.

    Args:
        words: What follows the program's name; the last word is being typed and may be empty.
    """
    *before, current = words or [""]
    name = next((word for word in before if not word.startswith("-")), None)
    if name is None:
        offered = Answer(tuple(COMMANDS.items()))
        if current.startswith("-"):
            offered = _options(app_options())
        return offered.starting_with(current)
    if name not in COMMANDS:
        return Answer()
    command, typed = load_command(name), before[before.index(name) + 1 :]
    context = command.make_context(name, list(typed), resilient_parsing=True)
    options = {word: each for each in command.params for word in each.opts if word[:1] == "-"}
    only_arguments = "--" in typed
    waiting = options.get(typed[-1]) if typed and not only_arguments else None
    if waiting is not None and not waiting.is_flag:
        return _value(waiting, current, context)
    if current.startswith("-") and not only_arguments:
        option, equals, value = current.partition("=")
        if equals and option in options:
            return _value(options[option], value, context).after(f"{option}=")
        return _options(command.params, context).starting_with(current)
    argument = _argument(command.params, context)
    return Answer() if argument is None else _value(argument, current, context)


def _given(parameter: Any, context: Any) -> bool:
    """Return whether a parameter was typed."""
    source = context.get_parameter_source(parameter.name)
    return source is not None and source.name == "COMMANDLINE"


def _options(parameters: Iterable[Any], context: Any = None) -> Answer:
    """Return the long names of options that may still be given."""
    return Answer(
        tuple(
            (max(each.opts, key=len), (each.help or "").partition(". ")[0].rstrip("."))
            for each in parameters
            if each.param_type_name == "option"
            and (context is None or each.multiple or not _given(each, context))
        )
    )


def _argument(parameters: Iterable[Any], context: Any) -> Any:
    """Return the argument that comes next, None if no more fit."""
    arguments = (each for each in parameters if each.param_type_name == "argument")
    return next((each for each in arguments if each.nargs < 0 or not _given(each, context)), None)


def _registry(context: Any) -> Registry:
    """Return the store that the command would use."""
    store = context.params.get("store")
    return Registry(locate_store(Path(store).expanduser() if store else None))


def _value(parameter: Any, word: str, context: Any) -> Answer:
    """Return the values of a parameter: its help's own word for them says which they are."""
    metavar = (parameter.metavar or "").strip("[].")
    if metavar in VALUES:
        return VALUES[metavar](word, context)
    if choices := getattr(parameter.type, "choices", ()):
        return Answer(tuple((choice, "") for choice in choices)).starting_with(word)
    if getattr(parameter.type, "name", "") == "path":
        return Answer(kind="directories" if metavar == "DIR" else "files")
    left, equals, _ = metavar.partition("=")  # N|auto, junit|sarif=FILE: what is in small letters is meant
    forms = left.split("|")
    if equals and "=" in word:
        return Answer(kind="files").after(word[: word.index("=") + 1])
    literal = tuple((f"{form}{equals}", "") for form in forms if form.isalnum() and form.islower())
    file = any(form.startswith("FILE") for form in forms)
    return Answer(literal, "files" if file else "words").starting_with(word)


def _skills(word: str, context: Any) -> Answer:
    """Return skills of the store, the versions of one, or skill files."""
    name, at, _ = word.partition("@")
    if "/" in word or word.startswith("~"):
        return Answer(kind="files")
    if at:
        return _versions(name, _registry(context)).starting_with(word)
    here = [entry for entry in Path.cwd().iterdir() if PLAIN.fullmatch(entry.name)]
    files = [(entry.name, "file") for entry in here if entry.suffix == ".h5"]
    folders = [(f"{entry.name}/", "") for entry in here if entry.is_dir() and not entry.name.startswith(".")]
    names = [(name, "skill") for name in _registry(context).names()]
    found = Answer((*names, *sorted(files), *sorted(folders))).starting_with(word)
    return found if found.words else Answer(kind="files")


def _versions(name: str, registry: Registry) -> Answer:
    numbers = registry.versions(name)
    if not numbers:
        return Answer()
    aliases = [(f"{name}@{alias}", f"version {n}") for alias, n in registry.aliases(name).items()]
    latest = (f"{name}@latest", f"version {numbers[-1]}")
    return Answer((latest, *aliases, *((f"{name}@{number}", "") for number in reversed(numbers))))


def _names(word: str, context: Any) -> Answer:
    return Answer(tuple((name, "skill") for name in _registry(context).names())).starting_with(word)


def _aliases(word: str, context: Any) -> Answer:
    """Return the aliases of the skill that is named before."""
    named = next(each for each in context.command.params if each.param_type_name == "argument")
    name = context.params[named.name].partition("@")[0]
    aliases = _registry(context).aliases(name)
    return Answer(tuple((alias, f"version {n}") for alias, n in aliases.items())).starting_with(word)


def _files(word: str, context: Any) -> Answer:
    return Answer(kind="files")


def _nothing(word: str, context: Any) -> Answer:
    return Answer()


def _outputs(word: str, context: Any) -> Answer:
    from skillctl.cli.documents import OUTPUTS

    return Answer(tuple((name, "") for name in OUTPUTS)).starting_with(word)


# By what a value is called in the help, without [] and ….
VALUES: dict[str, Callable[[str, Any], Answer]] = {
    "SKILL": _skills,
    "A": _skills,
    "B": _skills,
    "NAME": _names,
    "ALIAS": _aliases,
    "DATA": _files,
    "LINK": _nothing,
    "ADDRESS": _nothing,
    "OUTPUT": _outputs,
}
