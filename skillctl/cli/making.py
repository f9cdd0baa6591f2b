"""What ``learn``, ``merge``, ``combine`` and ``adapt`` have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from skillctl.cli import render, words
from skillctl.cli.options import LockedPlace, Making
from skillctl.cli.output import Output


def make(
    output: Output,
    label: str,
    making: Making,
    call: Callable[..., Any],
    blocks: Callable[[Any], Sequence[render.Block]],
    made_from: Callable[[Any], Iterable[Path]],
) -> Any:
    """Make a skill, leave its file as a build tool wants it, show the report and return it.

    Args:
        output: Where progress, notes and the report are shown.
        label: What is being done.
        making: Where the skill goes, and when it is made again.
        call: Makes it, given the keywords that all use-cases that make skills take.
        blocks: Describes the report on a skill that was made.
        made_from: Files that a depfile names, by the report; not asked if nothing was written.

    Raises:
        UsageError: A build tool's options without a file; and whatever the use-case raises.
    """
    from skillctl.usecases.target import finish_target, require_target

    file, depfile, if_changed = making.output, making.depfile, making.if_changed
    require_target(file, depfile, if_changed)
    asked = {"name": making.name, "note": making.message, "plot": making.plot, "force": making.force}
    with output.progress(label) as progress:
        report = call(output=file, progress=progress, **asked)
    written = report.written
    if written is not None:
        created = written.created
        finish_target(file, made_from(report), created=created, depfile=depfile, if_changed=if_changed)
    words.explain(output, report.notes, report.reasons if making.explain else ())
    for sentence in report.warnings:
        output.warning(sentence)

    def described() -> Sequence[render.Block]:
        if report.status != "up to date":
            return blocks(report)
        name = report.written.skill
        return [f"{name} is up to date: the same inputs and options gave it. --force makes it again."]

    output.result(report, described)
    return report


def files_of(parts: Iterable[Any], place: LockedPlace) -> list[Path]:
    """Return the files of the skills that a skill was made of, and the lock file if they are locked.

    They were there when they were read; another process may have removed them since.
    """
    from skillctl.store import Registry, locate_store, parse_reference

    def file_of(skill: str) -> Path:
        reference = parse_reference(skill)
        if isinstance(reference, Path):
            return reference
        return Registry(locate_store(place.store)).path_of(reference.name, int(reference.selector))

    files = [file_of(part.skill) for part in parts]
    return files if place.lock is None else [*files, place.lock.path]
