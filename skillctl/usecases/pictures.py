"""Pictures of skills, as files and for pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from skillctl.adapt.picture import task_picture
from skillctl.adapt.task_file import recorded_task
from skillctl.errors import StoreError, UsageError
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.plotting.fit import UNKNOWN, draw_fit
from skillctl.plotting.formats import require_few, require_picture
from skillctl.plotting.portrait import Portrait, motions_from, portrait_of
from skillctl.plotting.proof import Bounds, draw_proofs
from skillctl.plotting.skill import draw_family, draw_skill
from skillctl.plotting.style import Drawing, encode
from skillctl.plotting.task import draw_task
from skillctl.stability.certificate import certify
from skillctl.stability.parts import least
from skillctl.stability.report import Certificate, at_least
from skillctl.store import Artifact, read_skill, write_file
from skillctl.store.source import Source

if TYPE_CHECKING:  # both import the learner, which most pictures do not need
    from skillctl.adapt.asked import AskedTask
    from skillctl.evaluate.left_out import LeftOut
    from skillctl.usecases.verify_stability import VerifyReport


@dataclass(frozen=True)
class Picture:
    """A picture with its title, as SVG."""

    title: str
    svg: bytes


def picture_skill(name: str, artifact: Artifact, path: Path) -> None:
    """Draw a skill: field, demonstrations, motions, density, regions.

    Args:
        name: For the title.
        artifact: The skill with its demonstrations.
        path: The file; its suffix decides the format.

    Raises:
        UsageError: No such format.
        StoreError: The picture cannot be written.
    """
    _write(path, draw_skill(_portrait(name, artifact), kind_of(artifact.skill)))


def picture_family(
    name: str, child: Artifact, parents: Sequence[Source], shares: Sequence[float], path: Path
) -> None:
    """Draw a merged or combined skill beside the skills it was made from.

    Args:
        name: Of the child.
        child: As it was written.
        parents: From left to right.
        shares: The weight or prior of each.
        path: The file; its suffix decides the format.

    Raises:
        UsageError, StoreError: See ``picture_skill``.
    """
    word = "prior" if child.skill.kind == "combined" else "weight"
    members = [
        (_portrait(parent.name, parent.artifact), f"{word} {share:.3g}")
        for parent, share in zip(parents, shares, strict=True)
    ]
    _write(path, draw_family(members, (_portrait(name, child), kind_of(child.skill))))


def picture_fit(name: str, artifact: Artifact, left_out: Sequence[LeftOut], path: Path) -> None:
    """Draw a learned skill beside its demonstrations, and skills learned without one of them.

    Args:
        name: Of the skill.
        artifact: The skill with its demonstrations.
        left_out: Result of a validation; empty if there was none.
        path: The file; its suffix decides the format.

    Raises:
        UsageError, StoreError: See ``picture_skill``.
    """
    _write(path, _fit_figure(name, artifact, left_out))


def picture_proofs(report: VerifyReport, path: Path) -> None:
    """Draw where and how fast V shrinks, for every skill that could be read, if there is one.

    Of a chain that is drawn for each of its stages.

    Raises:
        UsageError: More skills or stages than fit into one figure, or see ``picture_skill``.
        StoreError: The picture cannot be written, or a skill changed since it was verified.
    """
    require_few(len(report.skills))
    proofs = [
        proof
        for verdict in report.skills
        if verdict.certificate is not None and verdict.path is not None
        for proof in _proofs(verdict.skill, reopened(verdict.path, verdict.digest), verdict.certificate)
    ]
    require_few(len(proofs))
    if proofs:
        _write(path, draw_proofs(proofs))


def reopened(path: Path, digest: str | None) -> Artifact:
    """Return the artifact at a path of a report.

    Raises:
        StoreError: It is not the same as when it was reported.
    """
    artifact = read_skill(path)
    if artifact.digest != digest:
        raise StoreError(f"{path}: changed while it was being drawn.", hint="Run the command again.")
    return artifact


def picture_task(asked: AskedTask, skill: Skill, path: Path) -> None:
    """Draw a task and the motions of a skill from starts all over its start box.

    Args:
        asked: The task.
        skill: Whose motions are drawn.
        path: The file; its suffix decides the format.

    Raises:
        UsageError: No such format, or neither two nor three coordinates.
        StoreError: The picture cannot be written.
    """
    _write(path, draw_task(task_picture(asked.task, skill, shown=asked.shown, like=asked.like)))


def pictures_of(name: str, artifact: Artifact, certificate: Certificate) -> list[Picture]:
    """Return all pictures of a skill: the skill, its fit if it was learned, its certificate.

    Args:
        name: For the titles.
        artifact: The skill with its demonstrations.
        certificate: Its certificate.
    """
    skill, portrait = artifact.skill, _portrait(name, artifact)
    figures = [("The skill", draw_skill(portrait, kind_of(skill)))]
    if skill.kind != "chain" and len(skill.leaves) == 1 and portrait.demonstrations:
        figures.append(("What it learned", _fit_figure(name, artifact, ())))
    if artifact.operation.command == "adapt":
        figures += [("The task", figure) for figure in _task_figures(artifact)]
    figures.append(("What is proved", draw_proofs(_proofs(name, artifact, certificate))))
    return [Picture(title, encode(figure, "svg")) for title, figure in figures]


def kind_of(skill: Skill) -> str:
    """Return the kind of a skill, in words."""
    if skill.kind == "combined":
        ends = "one target" if len(skill.attractors) == 1 else f"{len(skill.parts)} targets"
        return f"combined, {skill.gate}, {ends}"
    if skill.kind == "chain":
        return f"chain of {len(skill.parts)} stages"
    if skill.kind == "merged":
        return f"merged, {skill.gate}"
    return f"learned, {skill.n_components} components"


def bounds_of(certificate: Certificate) -> Bounds:
    """Return the parts of a certificate that a figure shows."""
    everywhere = certificate.scope == "global"
    words = certificate.verdict + (" (local proof)" if certificate.scope == "local" else "")
    if everywhere and certificate.rate is not None:
        words = f"{words}, decay rate at least {at_least(certificate.rate)} 1/s from everywhere"
    return Bounds(
        verdict=words,
        rates=_rates(certificate) if everywhere else (None, None),  # of as many blocks as there may be
        radii=tuple(part.radius for part in certificate.parts),
        witness=certificate.sampling.witness if certificate.sampling else None,
    )


def _rates(certificate: Certificate) -> tuple[float | None, ...]:
    """Return the proved rate of all parts: one, or those of position and orientation apart."""
    blocks = zip(*(part.blocks for part in certificate.parts), strict=True)
    return tuple(least([block.rate for block in each]) for each in blocks) or (certificate.rate,)


def _write(path: Path, figure: Drawing) -> None:
    write_file(path, encode(figure, require_picture(path)))


def _task_figures(artifact: Artifact) -> list[Drawing]:
    """Return the figure of the task that a skill was adapted to; none of one that cannot be drawn."""
    lines = cast("Sequence[str]", artifact.operation.results["task"])
    try:
        return [draw_task(task_picture(recorded_task(lines), artifact.skill))]
    except (ValueError, UsageError):  # it is what a file says: anything
        return []


def _proofs(name: str, artifact: Artifact, certificate: Certificate) -> list[tuple[Portrait, Bounds]]:
    """Return what a figure of a certificate shows: the skill, or each stage of a chain by itself."""
    if artifact.skill.kind != "chain":
        return [(_portrait(name, artifact), bounds_of(certificate))]
    taught = iter(artifact.demonstrations)
    return [
        (
            portrait_of(f"{name}, stage {number}", stage, [next(taught) for _ in stage.leaves]),
            bounds_of(certify(stage)),
        )
        for number, stage in enumerate(artifact.skill.parts, start=1)
    ]


def _portrait(name: str, artifact: Artifact) -> Portrait:
    return portrait_of(name, artifact.skill, artifact.demonstrations)


def _fit_figure(name: str, artifact: Artifact, left_out: Sequence[LeftOut]) -> Drawing:
    """Return the figure of a fit; the motion of a skill left one demonstration out starts where that does."""
    portrait = _portrait(name, artifact)
    goal = portrait.goals[0]
    held = [
        motions_from(retargeted(each.skill, goal), demonstration.positions[:1], demonstration.duration)[0]
        for each, demonstration in zip(left_out, portrait.demonstrations, strict=bool(left_out))
    ]
    errors = [(report.dtw, report.dtw_angle) for report in artifact.reports]
    moved = [(report.moved, report.moved_angle) for report in artifact.reports]
    return draw_fit(portrait, errors or [UNKNOWN] * len(portrait.demonstrations), held, moved)
