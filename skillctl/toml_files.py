"""Read TOML files, or say why they cannot be read."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, NotFoundError, printable

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its older name
    import tomli as tomllib

MAX_BYTES = 1 << 20


def parse_toml(data: bytes) -> dict[str, Any]:
    """Return the document that the bytes of a TOML file hold.

    Raises:
        ValueError: Not UTF-8, or not TOML.
    """
    try:
        return tomllib.loads(data.decode("utf-8"))  # what this raises are ValueErrors
    except RecursionError as error:  # but for brackets nested too deeply
        raise ValueError(str(error)) from None


def read_toml(path: Path, kind: str, hint: str) -> dict[str, Any]:
    """Return the document in a TOML file that somebody wrote.

    Args:
        path: The file.
        kind: What it should be, for messages: ``scenario``.
        hint: What to do if it is not.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is too long, or not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise NotFoundError(f"{path}: there is no such file.", hint=hint) from None
    if len(data) > MAX_BYTES:
        raise InputDataError(f"{path}: is no {kind}: it has more than {MAX_BYTES} bytes.", hint=hint)
    try:
        return parse_toml(data)
    except ValueError as error:
        raise InputDataError(f"{path}: is not TOML: {printable(str(error))[:200]}.", hint=hint) from None
