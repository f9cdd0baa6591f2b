"""What ``learn``, ``merge`` and ``combine`` have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillctl.cli import words
from skillctl.cli.options import LockedPlace, Making
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.progress import Progress


def make(
    output: Output,
    label: str,
    making: Making,
    call: Callable[..., Any],
    made_from: Callable[[Any], Iterable[Path]],
) -> Any:
    """Make a skill, leave its file as a build tool wants it, and return the report.

    Args:
        output: Where progress and notes are shown.
        label: What is being done.
        making: Where the skill goes, and when it is made again.
        call: Makes it, given the keywords that all use-cases that make skills take.
        made_from: Files that a depfile names, by the report.

    Raises:
        UsageError: A build tool's options without a file; and whatever the use-case raises.
    """
    from skillctl.usecases.target import finish_target, require_target

    require_target(making.output, making.depfile, making.if_changed)
    with output.progress(label) as progress:
        report = call(**_keywords(making, progress))
    finish_target(
        making.output,
        made_from(report),
        created=report.written.created,
        depfile=making.depfile,
        if_changed=making.if_changed,
    )
    words.explain(output, report.notes, report.reasons if making.explain else ())
    return report


def _keywords(making: Making, progress: Progress | None) -> dict[str, Any]:
    return {
        "output": making.output,
        "name": making.name,
        "note": making.message,
        "plot": making.plot,
        "force": making.force,
        "progress": progress,
    }


def files_of(parts: Iterable[Any], place: LockedPlace) -> list[Path]:
    """Return the files of the skills that a skill was made of, and the lock file if they are locked."""
    from skillctl.store import locate

    files = [locate(part.skill, place.store).path for part in parts]
    return files if place.lock is None else [*files, place.lock.path]
