"""The words that can follow those typed so far: the answer to a shell in which TAB was pressed.

Nothing heavy may be imported here, because the answer has to come at once.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from skillctl.cli.app import COMMANDS, group, load_command
from skillctl.cli.parameters import was_typed
from skillctl.cli.schema import OUTPUTS
from skillctl.drivers.registry import known
from skillctl.errors import SkillctlError, printable
from skillctl.store import Registry, locate_store

# Words that mean the same in every shell; files of other names are completed once ./ is typed.
PLAIN = re.compile(r"[\w.,+-]+")

Kind: TypeAlias = Literal["words", "files", "directories"]


@dataclass(frozen=True)
class Answer:
    """The answer to a shell.

    Attributes:
        words: Candidates with a few words of help, which may be empty. They complete the whole word.
        kind: What the shell itself completes besides: nothing, files, or directories.
        settled: How many characters of the word come before the name of that file, as in ``--output=``.
    """

    words: tuple[tuple[str, str], ...] = ()
    kind: Kind = "words"
    settled: int = 0

    def starting_with(self, prefix: str) -> Answer:
        """Return the answer for a word of which ``prefix`` is typed."""
        return replace(self, words=tuple(pair for pair in self.words if pair[0].startswith(prefix)))

    def after(self, typed: str) -> Answer:
        """Return the answer for a value that is typed directly behind its option."""
        words = tuple((f"{typed}{word}", text) for word, text in self.words)
        return Answer(words, self.kind, len(typed) + self.settled)

    def __str__(self) -> str:
        lines = [f"{word}\t{' '.join(printable(text).split())}".rstrip() for word, text in self.words]
        return "".join(f"{line}\n" for line in [f"{self.kind} {self.settled}", *lines])


FILES, NOTHING = Answer(kind="files"), Answer()


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
    if name is None and current[:1] != "-":
        return Answer(tuple(COMMANDS.items())).starting_with(current)
    if name is None:
        command, typed = group(), before
    elif name in COMMANDS:
        command, typed = load_command(name), before[before.index(name) + 1 :]
    else:
        return NOTHING
    context = command.make_context(name, list(typed), resilient_parsing=True)
    options = {word: each for each in command.params for word in each.opts if word[:1] == "-"}
    only_arguments = "--" in typed
    waiting = options.get(typed[-1]) if typed and not only_arguments else None
    if waiting is not None and not waiting.is_flag:
        return _value(waiting, current, context)
    option, equals, value = current.partition("=")
    if equals and option in options and not only_arguments:
        return _value(options[option], value, context).after(f"{option}=")
    if current.startswith("-") and not only_arguments:
        offered = command.shell_complete(context, current)
        known = [(item.value, (item.help or "").partition(". ")[0].rstrip(".")) for item in offered]
        return Answer(tuple(known)).starting_with("--")  # every option has a long name
    arguments = (each for each in command.params if each.param_type_name == "argument")
    following = (each for each in arguments if each.nargs < 0 or not was_typed(context, each.name))
    argument = next(following, None)
    return NOTHING if argument is None else _value(argument, current, context)


def _value(parameter: Any, word: str, context: Any) -> Answer:
    """Return the values of a parameter; the word for them in its help says which they are."""
    metavar = (parameter.metavar or "").strip("[].")
    if metavar in VALUES:
        return VALUES[metavar](word, context).starting_with(word)
    if choices := getattr(parameter.type, "choices", ()):
        return Answer(tuple((choice, "") for choice in choices)).starting_with(word)
    if getattr(parameter.type, "name", "") == "path":
        return FILES
    left, equals, _ = metavar.partition("=")  # N|auto, junit|sarif=FILE: what is in small letters is meant
    if equals and "=" in word:
        return FILES.after(word[: word.index("=") + 1])
    literal = [f"{form}{equals}" for form in left.split("|") if form.isalnum() and form.islower()]
    kind: Kind = "files" if "FILE" in left else "words"
    return Answer(tuple((form, "") for form in literal), kind).starting_with(word)


def _registry(context: Any) -> Registry:
    """Return the store that the command would use."""
    store = context.params.get("store")
    return Registry(locate_store(Path(store).expanduser() if store else None))


def _skills(word: str, context: Any) -> Answer:
    """Return skills of the store, the versions of one, or skill files."""
    name, at, _ = word.partition("@")
    if "/" in word or word.startswith("~"):
        return FILES
    if at:
        return _versions(name, _registry(context))
    here = [entry for entry in Path.cwd().iterdir() if PLAIN.fullmatch(entry.name)]
    files = [(entry.name, "file") for entry in here if entry.suffix == ".h5"]
    folders = [(f"{entry.name}/", "") for entry in here if entry.is_dir() and not entry.name.startswith(".")]
    names = _names(word, context).words
    found = Answer((*names, *sorted(files), *sorted(folders))).starting_with(word)
    return found if found.words else FILES


def _versions(name: str, registry: Registry) -> Answer:
    numbers = registry.versions(name)
    if not numbers:
        return NOTHING
    aliases = [(f"{name}@{alias}", f"version {n}") for alias, n in registry.aliases(name).items()]
    latest = (f"{name}@latest", f"version {numbers[-1]}")
    return Answer((latest, *aliases, *((f"{name}@{number}", "") for number in reversed(numbers))))


def _names(word: str, context: Any) -> Answer:
    return Answer(tuple((name, "skill") for name in _registry(context).names()))


def _aliases(word: str, context: Any) -> Answer:
    """Return the aliases of the skill that is named before."""
    named = next(each for each in context.command.params if each.param_type_name == "argument")
    aliases = _registry(context).aliases(context.params[named.name].partition("@")[0])
    return Answer(tuple((alias, f"version {n}") for alias, n in aliases.items()))


# By what a value is called in the help, without [] and ….
VALUES: dict[str, Callable[[str, Any], Answer]] = {
    **dict.fromkeys(("SKILL", "A", "B"), _skills),
    "NAME": _names,
    "ALIAS": _aliases,
    "DRIVER": lambda word, context: Answer(tuple((name, "") for name in sorted(known()))),
    "OUTPUT": lambda word, context: Answer(tuple((name, "") for name in OUTPUTS)),
    **dict.fromkeys(("DATA", "DEMO"), lambda word, context: FILES),
    "DIR": lambda word, context: Answer(kind="directories"),
    **dict.fromkeys(("LINK", "ADDRESS"), lambda word, context: NOTHING),
}
