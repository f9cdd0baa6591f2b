"""Signatures of what a skill holds: made and verified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from skillctl.store import (
    Lock,
    add_signature,
    make_signature,
    read_private_key,
    read_public_key,
    read_signatures,
    signature_state,
    signatures_path,
)
from skillctl.store.signing import SignatureState
from skillctl.store.source import Source, open_skill


@dataclass(frozen=True)
class _Signed:
    """A skill, a key, and where the signature is.

    Attributes:
        skill, digest: The skill.
        path: The file of its signatures, which need not exist.
        key: The public key, ``ed25519:…``.
    """

    skill: str
    digest: str
    path: Path
    key: str


@dataclass(frozen=True)
class SignReport(_Signed):
    """What ``sign`` did.

    Attributes:
        created: False if the signature was there already.
    """

    created: bool


@dataclass(frozen=True)
class SignatureReport(_Signed):
    """Whether a key has signed a skill.

    Attributes:
        state: ``valid``; ``invalid``; it signed ``other content``; only an ``other key`` did; ``unsigned``.
        explanation: The same as a sentence.
    """

    state: SignatureState
    explanation: str


def sign(
    reference: str | Path,
    key: Path,
    *,
    store: Path | None = None,
    lock: Lock | None = None,
    ask: Callable[[str], str] | None = None,
) -> SignReport:
    """Sign the content of a skill; its file stays as it is.

    Args:
        reference: The skill.
        key: PEM file with an Ed25519 private key.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        ask: Asks for the password of an encrypted key.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill, or the file
            beside it holds no signatures; or there is no such key, or ``cryptography`` is not installed.
        InputDataError: Not an Ed25519 private key.
        StoreError: The signature cannot be written.
    """
    private_key = read_private_key(key, ask)
    source = open_skill(reference, store, lock)
    signature = make_signature(source.artifact.digest, private_key)
    created = add_signature(source.located, signature)
    path = signatures_path(source.located.path)
    return SignReport(source.name, source.artifact.digest, path, signature.key, created)


def verify_signature(
    reference: str | Path, key: Path, *, store: Path | None = None, lock: Lock | None = None
) -> SignatureReport:
    """Return whether a key has signed what a skill holds now.

    Args:
        reference: The skill.
        key: PEM file with an Ed25519 public key.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill, or the file
            beside it holds no signatures; or there is no such key, or ``cryptography`` is not installed.
        InputDataError: Not an Ed25519 public key.
    """
    public_key = read_public_key(key)
    return check_signature(open_skill(reference, store, lock), public_key)


def check_signature(source: Source, key: str) -> SignatureReport:
    """Return whether a public key (``ed25519:…``) has signed a skill that was read.

    Raises:
        InvalidSignaturesError: The file beside it holds something else.
    """
    path = signatures_path(source.located.path)
    digest = source.artifact.digest
    signatures = read_signatures(source.located)
    state = signature_state(digest, signatures, key)
    others = ", ".join(sorted({signature.key for signature in signatures}))
    sentences: dict[SignatureState, str] = {
        "valid": f"{key} has signed {source.name}.",
        "invalid": f"the signature of {key} in {path} is not valid: it was changed.",
        "other content": f"{key} has signed other content than {source.name} holds now, {digest}.",
        "other key": f"{key} has not signed {source.name}; there are signatures of {others}.",
        "unsigned": f"{source.name} is not signed: there are no signatures in {path}.",
    }
    return SignatureReport(source.name, digest, path, key, state, sentences[state])
