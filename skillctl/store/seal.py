"""The first 512 bytes of an artifact: they say what the file is, and show that it is whole."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from skillctl.store.errors import DamagedArtifactError, InvalidArtifactError, NotAnArtifactError
from skillctl.store.files import read_beginning
from skillctl.store.migrations import FORMAT_VERSION, require_format

SEAL_BYTES = 512
# Not ASCII, CR LF, Ctrl-Z and LF: a transfer in text mode changes at least one of them.
MAGIC = b"\x89SKILL\r\n\x1a\n"

KINDS = ("seds", "merged", "combined", "chain")  # of a skill
_LATER_KINDS = {"chain": 2}  # by the format that brought them
_LINES = re.compile(
    rb"(\d{1,9}) (\d{1,12}) ([0-9a-f]{64})\n("
    + "|".join(KINDS).encode("ascii")
    + rb") (sha256:[0-9a-f]{64})\n\0+"
)


@dataclass(frozen=True, slots=True)
class Header:
    """What the first 512 bytes state; a list of skills reads no more than these.

    Attributes:
        body_bytes, sha256: Size and SHA-256 of all that follows.
        kind: ``seds``, ``merged``, ``combined`` or ``chain``.
        digest: Content digest, ``sha256:…``. A reader of the whole file checks it.
        format: Format version of the file.
    """

    body_bytes: int
    sha256: str
    kind: str
    digest: str
    format: int = FORMAT_VERSION

    @property
    def file_bytes(self) -> int:
        """Size of the whole file."""
        return SEAL_BYTES + self.body_bytes

    def to_bytes(self) -> bytes:
        """Return the 512 bytes."""
        lines = f"{self.format} {self.body_bytes} {self.sha256}\n{self.kind} {self.digest}\n"
        return (MAGIC + lines.encode("ascii")).ljust(SEAL_BYTES, b"\0")


def seal(body: bytes, kind: str, digest: str, version: int = FORMAT_VERSION) -> bytes:
    """Return the 512 bytes that belong in front of ``body``, a skill of that kind and content digest."""
    return Header(len(body), hashlib.sha256(body).hexdigest(), kind, digest, version).to_bytes()


def parse_header(beginning: bytes, size: int, name: str) -> Header:
    """Return what the first 512 bytes of a file of ``size`` bytes state; the rest is not read.

    Raises:
        NotAnArtifactError: It does not begin as an artifact does.
        TooNewFormatError, TooOldFormatError: Another format version.
        DamagedArtifactError: Cut or extended, or no artifact can begin like this.
    """
    if not beginning.startswith(MAGIC):
        _explain_magic(beginning, name)
    stated = re.match(rb"(\d{1,9}) ", beginning[len(MAGIC) : len(MAGIC) + 10])
    if stated:
        require_format(name, int(stated[1]))
    lines = _LINES.fullmatch(beginning[len(MAGIC) : SEAL_BYTES])
    if lines is None:
        raise DamagedArtifactError(name, f"its first {SEAL_BYTES} bytes are not a seal")
    sha256, kind, digest = (lines[group].decode("ascii") for group in (3, 4, 5))
    header = Header(int(lines[2]), sha256, kind, digest, int(lines[1]))
    if header.format < _LATER_KINDS.get(header.kind, 1):
        raise InvalidArtifactError(name, f"format {header.format} has no skills of kind {header.kind}")
    length = size - SEAL_BYTES
    if header.body_bytes != length:
        what = "cut short" if length < header.body_bytes else "extended"
        raise DamagedArtifactError(
            name, f"{what}: {length} bytes after the seal, {header.body_bytes} were written"
        )
    return header


def read_header(path: Path) -> Header:
    """Return what a file states in its first 512 bytes, without reading the rest.

    Raises:
        NotFoundError, StoreError: It cannot be read.
        ArtifactError: It is not an artifact of a readable format, or not of the stated size.
    """
    return parse_header(*read_beginning(path, SEAL_BYTES), str(path))


def require_seal(data: bytes, name: str) -> Header:
    """Raise unless ``data`` is a sealed artifact of a readable format, bit for bit as it was written.

    Raises:
        NotAnArtifactError: It does not begin as an artifact does.
        TooNewFormatError, TooOldFormatError: Another format version.
        DamagedArtifactError: Cut, extended or changed.
    """
    header = parse_header(data[:SEAL_BYTES], len(data), name)
    # A body of one kind and digest has exactly one seal, so one comparison checks all 512 bytes.
    if seal(data[SEAL_BYTES:], header.kind, header.digest, header.format) != data[:SEAL_BYTES]:
        raise DamagedArtifactError(name, "its contents do not match its seal")
    return header


def require_stated(header: Header, kind: str, digest: str, name: str) -> None:
    """Raise InvalidArtifactError unless the header states what the body holds."""
    for what, stated, found in (("a kind", header.kind, kind), ("a digest", header.digest, digest)):
        if stated != found:
            raise InvalidArtifactError(name, f"its seal states {what} of {stated}, but it holds {found}")


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
