"""A skill as one header in C99, and what such a header says of itself."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files

from skillctl import __version__
from skillctl.arrays import FloatArray
from skillctl.codegen.states import capped, states_around, stepped
from skillctl.codegen.tables import Tables
from skillctl.codegen.text import braced, kept, named, number, quoted
from skillctl.errors import ArtifactError
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.limits import Limits
from skillctl.model.skill import Skill

TESTS = 100
PERIOD = 0.01  # [s] of a test, unless only shorter ones are proved
RELATIVE, ABSOLUTE = 1e-9, 1e-12  # of a command, and of a state per period, by which a test may be off

FUNCTIONS = (
    "begin",
    "begin_unproved",
    "brake",
    "controller",
    "distance",
    "remaining",
    "reset",
    "resting",
    "step",
    "targets",
)
CODES = ("OK", "BAD_PERIOD", "BAD_LIMIT", "BAD_STATE", "BAD_STAGE")

_DIGEST = re.compile(r'^#define \w+_DIGEST "((?:sha256:[0-9a-f]{64})?)"$', re.MULTILINE)
_LAST = re.compile(r"/\* The lines above have the digest (sha256:[0-9a-f]{64})\. \*/\n")


@dataclass(frozen=True)
class Facts:
    """What a header says of a skill, beside its numbers.

    Attributes:
        name: As people know it.
        digest: Content digest of its artifact; empty if it has none.
        verdict, scope, proof: What is proved of it, in words.
        rate: Proved, [1/s]; None if none is.
        period: The longest that is proved, [s]; None if none is.
    """

    name: str
    digest: str
    verdict: str
    scope: str
    proof: str
    rate: float | None
    period: float | None


def prefix_of(name: str) -> str:
    """Return what the names of a skill begin with in C; ``skill`` alone stands for any skill."""
    word = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return word if word[:1].isalpha() and word != "skill" else f"my_{word or 'skill'}"


def header_of(skill: Skill, facts: Facts, taught: Sequence[FloatArray]) -> str:
    """Return the header of a skill.

    Args:
        skill: The skill.
        facts: What is known of it.
        taught: Its demonstrations, (n, d) each, for the header's own test; there may be none.

    Raises:
        UsageError: There is no C for one of its kinds of space, coordinates or gates.
    """
    tables, period = Tables(skill), tested_period(facts)
    template = files("skillctl.codegen").joinpath("runtime.h").read_text(encoding="utf-8")
    runtime = kept(template, tables.features)
    public = _public(skill, facts)
    internal = {
        **tables.limits,
        "POSITIONS_": str(skill.space.positions),
        **{
            f"TEST_{k}": number(v)
            for k, v in (("PERIOD", period), ("RELATIVE", RELATIVE), ("ABSOLUTE", ABSOLUTE))
        },
    }
    needed = {name: value for name, value in internal.items() if re.search(rf"\bSKILL_{name}\b", runtime)}
    prefix = prefix_of(facts.name)
    macros = {**public, **needed}
    blocks = {
        "FACTS": "\n".join(f"#define {prefix.upper()}_{name} {value}" for name, value in macros.items()),
        "TABLES": named("\n".join(tables.text), prefix),
        "ALIASES": _aliases(prefix, names_of(skill, facts), [name for name in macros if name[-1] != "_"]),
        "TESTS": ",\n".join(_tests(skill, period, taught)),
    }
    text = re.sub("@([A-Z]+)@", lambda found: blocks[found[1]], named(runtime, prefix))
    return f"{text}/* The lines above have the digest {_digest_of(text)}. */\n"


def names_of(skill: Skill, facts: Facts) -> tuple[str, ...]:
    """Return what a program uses of the header of a skill, by its names in C."""
    poses = () if skill.space.flat else ("state_of_pose",)
    stages = ("go", "stage") if isinstance(skill, ChainedSkill) else ()
    return tuple(f"{prefix_of(facts.name)}_{name}" for name in sorted((*FUNCTIONS, *poses, *stages)))


def tested_period(facts: Facts) -> float:
    """Return the period at which a header is tested, [s]."""
    return min(PERIOD, facts.period or PERIOD)


def digest_in(text: str, name: str) -> str:
    """Return the content digest of the skill that a header was made of; empty if it was made in Python.

    Args:
        text: Of the header.
        name: Of the file, for errors.

    Raises:
        ArtifactError: It is no header of a skill, or not as it was written.
    """
    lines = text.splitlines(keepends=True)
    last, found = _LAST.fullmatch(lines[-1]) if lines else None, _DIGEST.search(text)
    if last is None or found is None:
        raise ArtifactError(f"{name}: is not a header that skillctl has written.")
    if last[1] != _digest_of("".join(lines[:-1])):
        raise ArtifactError(
            f"{name}: was changed after it was written; nothing is known of it.",
            hint="Export it again: skillctl export SKILL -o FILE.h",
        )
    return found[1]


def _digest_of(text: str) -> str:
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _public(skill: Skill, facts: Facts) -> dict[str, str]:
    """Return the macros that say what a skill is."""
    space = skill.space
    return {
        "NAME": quoted(facts.name),
        "DIGEST": quoted(facts.digest),
        "WRITTEN_BY": quoted(f"skillctl {__version__}"),
        "VERDICT": quoted(facts.verdict),
        "SCOPE": quoted(facts.scope),
        "PROOF": quoted(facts.proof),
        "RATE": f"{number(facts.rate or 0.0)} /* [1/s] */",
        "PERIOD_MAX": f"{number(facts.period or 0.0)} /* [s] */",
        "FRAME": quoted(space.frame),
        "UNIT": quoted(space.unit),
        "NAMES": braced(map(quoted, space.names)),
        "UNITS": braced(map(quoted, space.units)),
        "DIMENSION": str(space.dimension),
        "TARGETS": str(len(skill.attractors)),
    }


def _aliases(prefix: str, names: Iterable[str], macros: Iterable[str]) -> str:
    """Return the names by which a program calls its only skill; with two of them they would be ambiguous."""
    generic = {f"skill{name.removeprefix(prefix)}": name for name in names}
    generic |= {f"SKILL_{name}": f"{prefix.upper()}_{name}" for name in (*macros, *CODES)}
    return "\n".join(
        [
            "#ifndef SKILL_GENERIC_NAMES /* a program with one skill may call it so */",
            "#define SKILL_GENERIC_NAMES /* once */",
            *(f"#define {other} {name}" for other, name in generic.items()),
            "#else /* of two skills it would not be known which is meant */",
            *(f"#undef {other}" for other in generic),
            "#endif /* of generic names */",
        ]
    )


def _tests(skill: Skill, period: float, taught: Sequence[FloatArray]) -> list[str]:
    """Return states and the commands of a controller that has just begun; every second one has a limit."""
    controller, tests = Controller(skill, period, allow_unproved=True), []
    for index, state in enumerate(states_around(skill, TESTS, taught)):
        limits = Limits()
        for _ in range(1 + index % 2):
            controller.reset()
            command = stepped(controller, state, limits)
            limits, given = capped(skill.space.speeds(command), (0.5, 0.8)), limits
        numbers = map(number, (given.speed,) if skill.space.flat else (given.speed, given.turn))
        rows = (braced(map(number, each.tolist())) for each in (state, command))
        tests.append("    " + braced([*numbers, *rows]))
    return tests
