"""A skill as a header in C99: written, compared with the skill, and traced back to its artifact."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from skillctl.arrays import FloatArray
from skillctl.codegen.check import Check, check
from skillctl.codegen.header import Facts, digest_in, header_of, tested_period
from skillctl.errors import ArtifactError, NotFoundError
from skillctl.model.skill import Skill
from skillctl.opening import open_regular
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import existing_store
from skillctl.store.registry import Registry
from skillctl.store.source import Source

SUFFIX = ".h"
LONGEST = 2**27  # bytes of a header that is read


def exported_c99(skill: Skill, name: str) -> str:
    """Return a skill as a header in C99, with what is proved of it; see the page on C.

    So skills are exported that no file holds, such as those that keep out of bodies (``kept_out``).

    Args:
        skill: The skill.
        name: As people know it; names in C begin with it.

    Raises:
        UsageError: There is no C for one of its kinds of space, coordinates or gates.
    """
    return header_of(skill, _facts(name, certify(skill)), ())


def c99_of(source: Source) -> tuple[str, Facts]:
    """Return the header of a skill that was read, and what it says of it."""
    digest = source.artifact.digest
    name = source.located.name or source.located.path.stem
    facts = _facts(name, certify(source.skill, digest=digest))
    return header_of(source.skill, facts, _taught(source)), facts


def checked(source: Source, header: str, facts: Facts) -> Check:
    """Return how a header compares with its skill; see ``codegen.check``.

    Raises:
        NotFoundError: There is no C compiler.
    """
    return check(source.skill, header, _taught(source), tested_period(facts), os.environ)


def exported_from(reference: str | Path, store: str | Path | None) -> str | Path:
    """Return the version of the store that a header was exported from; any other reference as it is.

    Args:
        reference: The header, a file that ends in ``.h``; or a skill.
        store: Where it is looked for; default as on the command line.

    Raises:
        ArtifactError: The file is no header of a skill, or was changed since.
        NotFoundError: The store does not have the skill.
    """
    path = Path(reference)
    if path.suffix != SUFFIX or not path.is_file():
        return reference
    with open_regular(path) as file:
        try:
            text = file.read(LONGEST).decode("ascii")
        except UnicodeDecodeError:
            raise ArtifactError(f"{path}: is not a header that skillctl has written.") from None
    digest, registry = digest_in(text, str(path)), Registry(existing_store(store))
    for name in registry.names():
        for version in reversed(registry.versions(name)):
            if registry.header(name, version).digest == digest:
                return f"{name}@{version}"
    made = f"it was made of {digest}" if digest else "it was made in Python of a skill that no file holds"
    raise NotFoundError(
        f"{path}: {made}, which the store {registry.root} does not have.",
        hint="Name the store with --store; or verify the skill's own file, whose digest has to be that one.",
    )


def _facts(name: str, certificate: Certificate) -> Facts:
    said = (*certificate.proof, *certificate.failures)[0]
    verdict, scope = certificate.verdict, certificate.scope
    return Facts(name, certificate.digest or "", verdict, scope, said, certificate.rate, certificate.period)


def _taught(source: Source) -> Sequence[FloatArray]:
    return [motion.positions for motion in source.artifact.taught]
