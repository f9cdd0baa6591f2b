"""What a build tool such as Make needs: times of files, and their dependencies."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from skillctl.errors import StoreError, UsageError
from skillctl.store import write_file


def require_target(output: Path | None, depfile: Path | None, if_changed: bool) -> None:
    """Raise UsageError if options for a build tool are given, and no file is written."""
    if output is None and (depfile is not None or if_changed):
        raise UsageError(
            f"{'--depfile' if depfile else '--if-changed'} is about a file, and none is written.",
            hint="Give -o FILE.h5; versions in the store never change.",
        )


def finish_target(
    output: Path | None,
    inputs: Iterable[Path],
    *,
    created: bool,
    depfile: Path | None = None,
    if_changed: bool = False,
) -> None:
    """Make a target newer than its inputs, and write down its dependencies, as a build tool needs it.

    Args:
        output: The file that was made or is up to date; None for a version of the store.
        inputs: Files it was made from.
        created: Whether it was written.
        depfile: File for the dependencies, in Make's syntax.
        if_changed: Leave the time of an unchanged target alone, so that nothing after it is made again.
    """
    if output is None:
        return
    if not created and not if_changed:
        try:
            output.touch()
        except OSError as error:
            raise StoreError(f"{output}: its time cannot be set: {error.strerror}.") from error
    if depfile is not None:
        write_file(depfile, os.fsencode(dependencies(output, inputs)))


def dependencies(output: Path, inputs: Iterable[Path]) -> str:
    """Return a rule without commands, and an empty rule for each input, in case it is removed."""
    names = [_escaped(path) for path in dict.fromkeys(inputs)]
    return "".join([f"{_escaped(output)}: {' '.join(names)}\n", *(f"{name}:\n" for name in names)])


def _escaped(path: Path) -> str:
    text = str(path).replace("$", "$$")
    for character in "# :":
        text = text.replace(character, f"\\{character}")
    if "\n" in text or "\t" in text:
        raise UsageError(f"{text!r}: Make cannot name a file with a tab or line break in its name.")
    return text
