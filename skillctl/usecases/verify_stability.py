"""What is proved of skills, re-derived from their stored numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import SkillctlError
from skillctl.model import Skill
from skillctl.model.skill import CombinedSkill, MergedSkill, SedsSkill
from skillctl.stability import Certificate, certify
from skillctl.usecases.files import open_skill


@dataclass(frozen=True)
class SkillVerdict:
    """What is known of one skill: a certificate, or why it could not be read.

    Attributes:
        skill: As it was named; with its version, if it is one of the store.
        path: Its file, None if there is none.
        digest: Content digest that the certificate holds for.
        certificate: What is proved; None if the skill could not be read.
        error: Why not.
    """

    skill: str
    path: Path | None
    digest: str | None
    certificate: Certificate | None
    error: SkillctlError | None


@dataclass(frozen=True)
class VerifyReport:
    """The verdicts, in the order in which the skills were named."""

    skills: tuple[SkillVerdict, ...]


def verify_stability(references: Sequence[str | Path], *, store: Path | None = None) -> VerifyReport:
    """Return what is proved of each skill; those that cannot be read do not keep others from being checked.

    Args:
        references: Files, or names of the store.
        store: Where names live; default as on the command line.
    """
    return VerifyReport(tuple(_verdict(str(reference), store) for reference in references))


def verify(skill: Skill | str | Path, *, store: Path | None = None) -> Certificate:
    """Return what is proved of one skill, given as such or by reference.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill.
    """
    if isinstance(skill, SedsSkill | MergedSkill | CombinedSkill):
        return certify(skill)
    source = open_skill(skill, store)
    return certify(source.skill, digest=source.artifact.digest)


def _verdict(reference: str, store: Path | None) -> SkillVerdict:
    try:
        source = open_skill(reference, store)
    except SkillctlError as error:
        return SkillVerdict(reference, None, None, None, error)
    digest = source.artifact.digest
    certificate = certify(source.skill, digest=digest)
    return SkillVerdict(source.name, source.located.path, digest, certificate, None)
