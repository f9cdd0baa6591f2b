"""The first 512 bytes of an artifact: they tell what the file is and that it is whole."""

from __future__ import annotations

import hashlib
import re

from skillctl.store.errors import DamagedArtifactError, NotAnArtifactError, require_format
from skillctl.store.layout import FORMAT_VERSION

SEAL_BYTES = 512
# Not ASCII, CR LF, Ctrl-Z and LF: whatever a text-mode transfer changes, it changes here first.
MAGIC = b"\x89SKILL\r\n\x1a\n"

_LINE = re.compile(rb"(\d{1,9}) (\d{1,12}) ([0-9a-f]{64})\n\0+")


def seal(body: bytes) -> bytes:
    """Return the 512 bytes that belong in front of ``body``."""
    line = f"{FORMAT_VERSION} {len(body)} {hashlib.sha256(body).hexdigest()}\n"
    return (MAGIC + line.encode("ascii")).ljust(SEAL_BYTES, b"\0")


def require_seal(data: bytes, name: str) -> None:
    """Raise unless ``data`` is a sealed artifact of a readable format, bit for bit as it was written.

    Raises:
        NotAnArtifactError: It does not begin as an artifact does.
        TooNewFormatError, TooOldFormatError: Another format version.
        DamagedArtifactError: Cut, extended or changed.
    """
    if not data.startswith(MAGIC):
        _explain_magic(data, name)
    stated = re.match(rb"(\d{1,9}) ", data[len(MAGIC) : len(MAGIC) + 10])
    if stated:
        require_format(name, int(stated[1]))
    line = _LINE.fullmatch(data[len(MAGIC) : SEAL_BYTES])
    if line is None:
        raise DamagedArtifactError(
            name, f"its first {SEAL_BYTES} bytes are not a seal (format {FORMAT_VERSION})"
        )
    stated_length, length = int(line[2]), len(data) - SEAL_BYTES
    if stated_length != length:
        what = "cut short" if length < stated_length else "extended"
        raise DamagedArtifactError(
            name, f"{what}: {length} bytes after the seal, {stated_length} were written"
        )
    # One comparison settles all 512 bytes: there is exactly one seal for a body.
    if seal(data[SEAL_BYTES:]) != data[:SEAL_BYTES]:
        raise DamagedArtifactError(name, "its contents do not match its seal")


def _explain_magic(data: bytes, name: str) -> None:
    if not data:
        raise NotAnArtifactError(name, "the file is empty")
    if data.startswith((b"\x89SKILL\n", b"\x89SKILL\r\r", b"\x09SKILL")):
        raise DamagedArtifactError(name, "a transfer in text mode changed its line ends")
    if MAGIC.startswith(data):
        raise DamagedArtifactError(name, f"cut short after {len(data)} bytes")
    if data.startswith(b"\x89HDF\r\n\x1a\n"):
        raise NotAnArtifactError(name, "a plain HDF5 file, without the seal of an artifact")
    raise NotAnArtifactError(name, "it does not begin with the signature of one")
