"""Ed25519 signatures of a skill's content: beside its file, in ``F.h5.sig``; the file stays as it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from skillctl.errors import InputDataError, NotFoundError, printable
from skillctl.opening import read_from_pipe_or_file
from skillctl.store.errors import InvalidSignaturesError
from skillctl.store.files import missing_file, read_once, refused_as, system_errors, write_file
from skillctl.store.folder import SIGNATURE_SUFFIX
from skillctl.store.local import locked_directory

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    from skillctl.store.registry import Located

Key = TypeVar("Key")
SignatureState: TypeAlias = Literal["valid", "invalid", "other content", "other key", "unsigned"]

MAX_BYTES = 1 << 16  # of a key, and of all signatures of a skill
# The signed message begins like this, so that no signature made for another purpose fits.
DOMAIN = b"skillctl signature of a skill, 1\n"

_LINE = re.compile(r"(ed25519:[0-9a-f]{64}) (sha256:[0-9a-f]{64}) ([0-9a-f]{128})")
_HEADING = "# Signatures of a skill, written by `skillctl sign`: public key, content digest, signature.\n"
_MAKE_KEYS = "`openssl genpkey -algorithm ed25519 -out key.pem` makes one."


@dataclass(frozen=True, slots=True)
class Signature:
    """One signature as a file states it; it means nothing until it is verified.

    Attributes:
        key: Public key of the signer, ``ed25519:…``.
        digest: Content digest that was signed, ``sha256:…``.
        value: The signature, in hexadecimal digits.
    """

    key: str
    digest: str
    value: str


def signed_message(digest: str) -> bytes:
    """Return the bytes that a signature of a content digest signs."""
    return DOMAIN + digest.encode("ascii") + b"\n"


def make_signature(digest: str, private_key: Ed25519PrivateKey) -> Signature:
    """Return the signature of a content digest."""
    public = f"ed25519:{private_key.public_key().public_bytes_raw().hex()}"
    return Signature(public, digest, private_key.sign(signed_message(digest)).hex())


def signature_state(digest: str, signatures: Iterable[Signature], key: str) -> SignatureState:
    """Return whether a public key has signed a content digest.

    ``other content``: it signed something else; ``other key``: only other keys have signed.

    Raises:
        NotFoundError: ``cryptography`` is not installed.
    """
    everything = list(signatures)
    own = [signature for signature in everything if signature.key == key]
    if not own:
        return "other key" if everything else "unsigned"
    if any(_verifies(signature, key, digest) for signature in own):
        return "valid"
    if any(_verifies(signature, key, signature.digest) for signature in own):
        return "other content"
    return "invalid"


def _verifies(signature: Signature, key: str, digest: str) -> bool:
    crypto = _cryptography()
    public = crypto.ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(key.removeprefix("ed25519:")))
    try:
        public.verify(bytes.fromhex(signature.value), signed_message(digest))
    except crypto.InvalidSignature:
        return False
    return True


def signatures_path(artifact: Path) -> Path:
    """Return where the signatures of the skill in a file are."""
    return artifact.with_name(artifact.name + SIGNATURE_SUFFIX)


def read_signatures(located: Located) -> tuple[Signature, ...]:
    """Return the signatures beside an artifact; none without the file. None of them is verified.

    Raises:
        InvalidSignaturesError: The file holds something else.
        StoreError: The system does not let us read it.
    """
    path = signatures_path(located.path)
    try:
        with refused_as(InvalidSignaturesError, str(path)):
            lines = _read(located, path).decode("ascii").splitlines()
    except NotFoundError:
        return ()
    found = []
    for number, line in enumerate(lines, start=1):
        if not line or line.startswith("#"):
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise InvalidSignaturesError(str(path), f"line {number} is not a signature")
        found.append(Signature(match[1], match[2], match[3]))
    return tuple(found)


def add_signature(located: Located, signature: Signature) -> bool:
    """Put a signature beside an artifact; return False if it was there.

    Signatures of the same content by other keys are kept; signatures of other content are removed.

    Raises:
        InvalidSignaturesError: The file that is there holds something else; it is left as it is.
        StoreError: No permission, no space.
    """
    with system_errors(f"sign {located.path}"), _locked(located):  # two signers must not lose one
        there = read_signatures(located)
        if signature in there:
            return False
        kept = [s for s in there if s.digest == signature.digest and s.key != signature.key]
        _write(located, signatures_path(located.path), _text([*kept, signature]).encode("ascii"))
    return True


def _read(located: Located, path: Path) -> bytes:
    if located.backend is None or located.name is None:
        return read_once(path, MAX_BYTES)
    return located.backend.read(located.name, path.name, MAX_BYTES)


def _write(located: Located, path: Path, data: bytes) -> None:
    if located.backend is None or located.name is None:
        write_file(path, data)
    else:
        located.backend.replace(located.name, path.name, data)


def _locked(located: Located) -> AbstractContextManager[None]:
    if located.backend is None or located.name is None:
        return locked_directory(located.path.parent)
    return located.backend.locked(located.name)


def _text(signatures: Iterable[Signature]) -> str:
    lines = sorted(f"{signature.key} {signature.digest} {signature.value}\n" for signature in signatures)
    return "".join([_HEADING, *lines])


def read_private_key(path: Path, ask: Callable[[str], str] | None = None) -> Ed25519PrivateKey:
    """Return the private key in a PEM file.

    Args:
        path: The file.
        ask: Asks for the password of an encrypted key; None where there is no terminal.

    Raises:
        NotFoundError: No such file, or ``cryptography`` is not installed.
        InputDataError: Not an Ed25519 private key, or an encrypted one that cannot be decrypted.
        StoreError: The file cannot be read.
    """
    crypto, data, shown = _cryptography(), _key_bytes(path), printable(str(path))
    if b"PUBLIC KEY" in data:
        raise InputDataError(
            f"{shown} holds a public key; signing takes the private one.",
            hint="Name the file that was made by `openssl genpkey`.",
        )
    password, wrong = None, ""
    if b"ENCRYPTED" in data:
        if ask is None:
            raise InputDataError(
                f"{shown} is encrypted, and there is no terminal to ask for its password on.",
                hint="Sign at a terminal, or with a key of its own for the pipeline.",
            )
        password, wrong = ask(f"Password of {shown}").encode(), "the password is wrong, or "
    with _readable(f"{shown}: {wrong}this is not a private key in PEM form.", _MAKE_KEYS):
        loaded = crypto.serialization.load_pem_private_key(data, password)
        key: Ed25519PrivateKey = _of_kind(crypto.ed25519.Ed25519PrivateKey, loaded, shown)
    return key


def read_public_key(path: Path) -> str:
    """Return the public key in a PEM file, ``ed25519:…``.

    Raises:
        NotFoundError: No such file, or ``cryptography`` is not installed.
        InputDataError: Not an Ed25519 public key.
        StoreError: The file cannot be read.
    """
    crypto, data, shown = _cryptography(), _key_bytes(path), printable(str(path))
    extract = "`openssl pkey -in key.pem -pubout -out public.pem` writes the public key of a private one."
    if b"PRIVATE KEY" in data:
        raise InputDataError(
            f"{shown} holds a private key; verifying takes the public one.", hint=f"Keep it secret. {extract}"
        )
    with _readable(f"{shown} is not a public key in PEM form.", extract):
        loaded = crypto.serialization.load_pem_public_key(data)
        key = _of_kind(crypto.ed25519.Ed25519PublicKey, loaded, shown)
    return f"ed25519:{key.public_bytes_raw().hex()}"


@contextmanager
def _readable(message: str, hint: str) -> Iterator[None]:
    try:
        yield
    except (ValueError, TypeError, _cryptography().UnsupportedAlgorithm):
        raise InputDataError(message, hint=hint) from None


def _of_kind(kind: type[Key], key: object, shown: str) -> Key:
    if isinstance(key, kind):
        return key
    found = type(key).__name__.lstrip("_").removesuffix("PrivateKey").removesuffix("PublicKey")
    raise InputDataError(f"{shown} holds a key of the kind {found}; expected Ed25519.", hint=_MAKE_KEYS)


def _key_bytes(path: Path) -> bytes:
    """Return what a key file holds; keys may lie behind links and in pipes."""
    with system_errors(f"read {path}"):
        try:
            data = read_from_pipe_or_file(path, MAX_BYTES + 1)
        except FileNotFoundError:
            raise missing_file(path) from None
    if len(data) > MAX_BYTES:
        raise InputDataError(f"{printable(str(path))} is too large for a key.", hint="Name the key's file.")
    return data


class _Cryptography:
    """The parts of the package ``cryptography`` that are used, imported when a key is."""

    def __init__(self) -> None:
        from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519

        self.InvalidSignature, self.UnsupportedAlgorithm = InvalidSignature, UnsupportedAlgorithm
        self.serialization, self.ed25519 = serialization, ed25519


def _cryptography() -> _Cryptography:
    try:
        return _Cryptography()
    except ImportError as error:
        raise NotFoundError(
            "the package cryptography is not installed; only signatures need it.",
            hint="Install it: pip install cryptography",
        ) from error
