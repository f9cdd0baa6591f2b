"""Pictures of skills: gathered here, drawn by the plotting room, written whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skillctl.errors import StoreError, UsageError
from skillctl.model.skill import CombinedSkill, MergedSkill, Skill, retargeted
from skillctl.plotting.decay import Bounds
from skillctl.plotting.fit import draw_fit
from skillctl.plotting.formats import require_format
from skillctl.plotting.portrait import Portrait, motions_from, portrait_of
from skillctl.plotting.proof import draw_proofs
from skillctl.plotting.skill import draw_family, draw_skill
from skillctl.plotting.style import Drawing, encode
from skillctl.stability import Certificate, certify
from skillctl.stability.report import at_least
from skillctl.store import Artifact, read_skill, write_file
from skillctl.usecases.files import Source, open_skill

if TYPE_CHECKING:  # both bring the learner along, which most pictures can do without
    from skillctl.usecases.validate import LeftOut
    from skillctl.usecases.verify_stability import VerifyReport

MOST_PROOFS = 12  # rows of one figure


@dataclass(frozen=True)
class Picture:
    """A picture with its title, as SVG."""

    title: str
    svg: bytes


def require_picture(path: Path) -> None:
    """Raise UsageError unless a picture can be written there; asked before any work is done."""
    require_format(path)
    if not path.parent.is_dir():
        raise UsageError(
            f"{path.parent}: there is no such directory.", hint=f"Make it: mkdir -p {path.parent}"
        )


def picture_skill(reference: str | Path, path: Path, *, store: Path | None = None) -> None:
    """Draw what is in a skill: field, demonstrations, motions, density, regions.

    Args:
        reference: File, or name of the store.
        path: Where to; its suffix decides the format.
        store: Where names live; default as on the command line.

    Raises:
        UsageError: No such format, or no such directory.
        NotFoundError, ArtifactError: The reference leads to no intact skill.
        StoreError: The picture cannot be written.
    """
    require_picture(path)
    source = open_skill(reference, store)
    figure = draw_skill(_portrait(source.name, source.artifact), kind_of(source.skill))
    write_file(path, encode(figure, require_format(path)))


def picture_family(
    name: str, child: Artifact, parents: Sequence[Source], shares: Sequence[float], path: Path
) -> None:
    """Draw a merged or combined skill beside the skills it was made from.

    Args:
        name: Of the child.
        child: As it was written.
        parents: From left to right.
        shares: The weight or prior of each.
        path: Where to; its suffix decides the format.

    Raises:
        UsageError, StoreError: See ``picture_skill``.
    """
    require_picture(path)
    word = "prior" if isinstance(child.skill, CombinedSkill) else "weight"
    members = [
        (_portrait(parent.name, parent.artifact), f"{word} {share:.3g}")
        for parent, share in zip(parents, shares, strict=True)
    ]
    figure = draw_family(members, (_portrait(name, child), kind_of(child.skill)))
    write_file(path, encode(figure, require_format(path)))


def picture_fit(name: str, artifact: Artifact, left_out: Sequence[LeftOut], path: Path) -> None:
    """Draw how a learned skill repeats its demonstrations, and skills learned without one of them.

    Args:
        name: Of the skill.
        artifact: The skill with its demonstrations.
        left_out: Result of a validation; empty if there was none.
        path: Where to; its suffix decides the format.

    Raises:
        UsageError, StoreError: See ``picture_skill``.
    """
    require_picture(path)
    write_file(path, encode(_fit_figure(name, artifact, left_out), require_format(path)))


def picture_proofs(report: VerifyReport, path: Path) -> None:
    """Draw where and how fast V shrinks, for every skill that could be read; nothing if none could.

    Raises:
        UsageError: More skills than fit into one figure, or see ``picture_skill``.
        StoreError: The picture cannot be written, or a skill changed since it was verified.
    """
    require_picture(path)
    require_few(len(report.skills))
    proofs = []
    for verdict in report.skills:
        if verdict.certificate is None or verdict.path is None:
            continue
        artifact = read_skill(verdict.path)
        if artifact.digest != verdict.digest:
            raise StoreError(f"{verdict.path}: changed since it was verified.", hint="Verify it again.")
        proofs.append((_portrait(verdict.skill, artifact), bounds_of(verdict.certificate)))
    if proofs:
        write_file(path, encode(draw_proofs(proofs), require_format(path)))


def require_few(skills: int) -> None:
    """Raise UsageError for more skills than one figure of certificates can show."""
    if skills > MOST_PROOFS:
        raise UsageError(
            f"plot: {skills} skills are more than one picture shows; expected at most {MOST_PROOFS}.",
            hint="Draw them in several calls.",
        )


def pictures_of(reference: str | Path, *, store: Path | None = None) -> list[Picture]:
    """Return all pictures of a skill: the skill, its fit if it was learned, its certificate.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill.
    """
    source = open_skill(reference, store)
    artifact = source.artifact
    portrait = _portrait(source.name, artifact)
    certificate = certify(source.skill, digest=artifact.digest)
    figures = [("The skill", draw_skill(portrait, kind_of(source.skill)))]
    if len(source.skill.leaves) == 1 and portrait.demonstrations:
        figures.append(("What it learned", _fit_figure(source.name, artifact, ())))
    figures.append(("What is proved", draw_proofs([(portrait, bounds_of(certificate))])))
    return [Picture(title, encode(figure, "svg")) for title, figure in figures]


def kind_of(skill: Skill) -> str:
    """Return what kind of skill it is, in words."""
    if isinstance(skill, CombinedSkill):
        ends = "one target" if skill.aligned else f"{len(skill.parts)} targets"
        return f"combined, {skill.gate}, {ends}"
    if isinstance(skill, MergedSkill):
        return f"merged, {skill.gate}"
    return f"learned, {skill.n_components} components"


def bounds_of(certificate: Certificate) -> Bounds:
    """Return what a figure shows of a certificate."""
    everywhere = certificate.scope == "global"
    told = certificate.verdict if everywhere else f"{certificate.verdict} ({certificate.scope} proof)"
    if everywhere and certificate.rate is not None:
        told = f"{told}, decay rate at least {at_least(certificate.rate)} 1/s from everywhere"
    return Bounds(
        verdict=told,
        rate=certificate.rate if everywhere else None,
        radii=tuple(part.radius for part in certificate.parts),
        witness=certificate.sampling.witness if certificate.sampling else None,
    )


def _portrait(name: str, artifact: Artifact) -> Portrait:
    return portrait_of(name, artifact.skill, artifact.demonstrations)


def _fit_figure(name: str, artifact: Artifact, left_out: Sequence[LeftOut]) -> Drawing:
    """Return the figure of a fit; motions of skills learned without a demonstration start where it starts."""
    portrait = _portrait(name, artifact)
    goal = portrait.goals[0]
    held = [
        motions_from(retargeted(each.skill, goal), shown.positions[:1], shown.duration)[0]
        for each, shown in zip(left_out, portrait.demonstrations, strict=bool(left_out))
    ]
    errors = [report.dtw for report in artifact.reports]
    return draw_fit(portrait, errors or [None] * len(portrait.demonstrations), held)
