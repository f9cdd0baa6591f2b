"""Signatures: made by us and verified by OpenSSL, and the other way round; nothing else passes."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from skillctl import store
from skillctl.errors import InputDataError, NotFoundError, StoreError
from skillctl.store.errors import InvalidSignaturesError

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")

DIGEST, OTHER = f"sha256:{'1' * 64}", f"sha256:{'2' * 64}"


def openssl(*arguments):
    return subprocess.run(["openssl", *map(str, arguments)], capture_output=True, check=False, timeout=60)


def make_key(folder, name, kind="ed25519"):
    private, public = folder / f"{name}.pem", folder / f"{name}.pub"
    for made in (
        openssl("genpkey", "-algorithm", kind, "-out", private),
        openssl("pkey", "-in", private, "-pubout", "-out", public),
    ):
        assert made.returncode == 0, made.stderr
    return private, public


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Two pairs of private and public key files."""
    folder = tmp_path_factory.mktemp("keys")
    return [make_key(folder, name) for name in ("ours", "theirs")]


def signed(keys, digest=DIGEST):
    return store.make_signature(digest, store.read_private_key(keys[0]))


def message(digest):
    """What is signed, by the format page."""
    return b"skillctl signature of a skill, 1\n" + digest.encode() + b"\n"


def test_openssl_verifies_what_we_sign(keys, tmp_path):
    (tmp_path / "message").write_bytes(message(DIGEST))
    (tmp_path / "signature").write_bytes(bytes.fromhex(signed(keys[0]).value))
    command = ["pkeyutl", "-verify", "-pubin", "-inkey", keys[0][1], "-rawin", "-in", tmp_path / "message"]
    assert openssl(*command, "-sigfile", tmp_path / "signature").returncode == 0
    (tmp_path / "message").write_bytes(message(OTHER))
    assert openssl(*command, "-sigfile", tmp_path / "signature").returncode != 0


def test_we_verify_what_openssl_signs(keys, tmp_path):
    (tmp_path / "message").write_bytes(message(DIGEST))
    made = openssl("pkeyutl", "-sign", "-inkey", keys[0][0], "-rawin", "-in", tmp_path / "message")
    key = store.read_public_key(keys[0][1])
    assert (
        key == f"ed25519:{openssl('pkey', '-pubin', '-in', keys[0][1], '-outform', 'DER').stdout[-32:].hex()}"
    )
    assert store.signature_state(DIGEST, [store.Signature(key, DIGEST, made.stdout.hex())], key) == "valid"


def test_a_signature_holds_for_one_content_and_one_key(keys):
    ours, theirs = (store.read_public_key(public) for _, public in keys)
    signature = signed(keys[0])
    assert store.signature_state(DIGEST, [], ours) == "unsigned"
    assert store.signature_state(DIGEST, [signature], ours) == "valid"
    assert store.signature_state(DIGEST, [signature], theirs) == "other key"
    assert store.signature_state(OTHER, [signature], ours) == "other content"
    # A file may say what it likes: another digest or key beside a signature does not make it one.
    relabelled = store.Signature(ours, OTHER, signature.value)
    assert store.signature_state(OTHER, [relabelled], ours) == "invalid"
    claimed = store.Signature(theirs, DIGEST, signature.value)
    assert store.signature_state(DIGEST, [claimed], theirs) == "invalid"
    assert store.signature_state(DIGEST, [claimed, signed(keys[1])], theirs) == "valid"


def test_no_flipped_bit_of_a_signature_passes(keys):
    key, signature = store.read_public_key(keys[0][1]), signed(keys[0])
    for bit in range(512):
        value = f"{int(signature.value, 16) ^ (1 << bit):0128x}"
        flipped = store.Signature(key, DIGEST, value)
        assert store.signature_state(DIGEST, [flipped], key) == "invalid"


# ---------------------------------------------------------------------------------------------------------
# The file beside the skill


def test_signatures_of_others_stay_and_those_of_what_was_there_before_go(keys, tmp_path):
    artifact = tmp_path / "a.h5"
    assert store.read_signatures(store.Located(artifact)) == ()
    assert store.add_signature(store.Located(artifact), signed(keys[0], OTHER))
    assert store.add_signature(store.Located(artifact), signed(keys[0]))
    assert store.add_signature(store.Located(artifact), signed(keys[1]))
    both = {signed(pair) for pair in keys}
    assert set(store.read_signatures(store.Located(artifact))) == both
    before = store.signatures_path(artifact).stat().st_mtime_ns
    assert not store.add_signature(store.Located(artifact), signed(keys[0]))
    assert store.signatures_path(artifact).stat().st_mtime_ns == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5.sig"]


def test_many_signers_at_once_lose_none(tmp_path):
    artifact = store.Located(tmp_path / "a.h5")
    wanted = {store.Signature(f"ed25519:{i:064x}", DIGEST, "0" * 128) for i in range(40)}
    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(partial(store.add_signature, artifact), wanted))
    assert set(store.read_signatures(artifact)) == wanted


@pytest.mark.parametrize(
    "content",
    [
        b"\xff",
        b"hello\n",
        b"<<<<<<< mine\n",
        b"ed25519:" + b"0" * 63 + b" " + DIGEST.encode() + b" " + b"0" * 128,
        b"rsa:" + b"0" * 64 + b" " + DIGEST.encode() + b" " + b"0" * 128,
        b"#" * (1 << 17),
    ],
)
def test_what_are_no_signatures_is_refused_and_left_as_it_is(keys, tmp_path, content):
    artifact = store.Located(tmp_path / "a.h5")
    (path := store.signatures_path(artifact.path)).write_bytes(content)
    for use in (store.read_signatures, lambda located: store.add_signature(located, signed(keys[0]))):
        with pytest.raises(InvalidSignaturesError, match=r"a\.h5\.sig"):
            use(artifact)
    assert path.read_bytes() == content


def test_a_planted_link_is_neither_followed_nor_replaced(keys, tmp_path):
    (tmp_path / "target").write_text("precious")
    (tmp_path / "a.h5.sig").symlink_to(tmp_path / "target")
    with pytest.raises(InvalidSignaturesError, match="symbolic link"):
        store.add_signature(store.Located(tmp_path / "a.h5"), signed(keys[0]))
    assert (tmp_path / "target").read_text() == "precious"


def test_a_disk_that_refuses_is_said(keys, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(StoreError, match="No space"):
        store.add_signature(store.Located(tmp_path / "a.h5"), signed(keys[0]))
    assert list(tmp_path.iterdir()) == []


def test_removing_a_version_removes_its_signatures_and_no_others(keys, tmp_path, wrap, make_seds):
    registry = store.Registry(tmp_path / "skills")
    for seed in (1, 2):
        published = registry.publish("reach", store.encode(wrap(make_seds(seed))))
        store.add_signature(store.Located(published.path), signed(keys[0], published.digest))
    assert registry.versions("reach") == (1, 2)
    registry.remove("reach", [1])
    names = sorted(path.name for path in (tmp_path / "skills" / "reach").iterdir())
    assert names == ["2.h5", "2.h5.sig"]
    registry.remove("reach", [2])
    assert [path.name for path in (tmp_path / "skills" / "reach").iterdir()] == ["2.removed"]


# ---------------------------------------------------------------------------------------------------------
# Keys


@pytest.mark.parametrize("kind", ["rsa", "x25519", "ed448"])
def test_keys_of_other_kinds_are_named(tmp_path, kind):
    private, public = make_key(tmp_path, "key", kind)
    for read, path in ((store.read_private_key, private), (store.read_public_key, public)):
        with pytest.raises(InputDataError, match=f"(?i){kind}; expected Ed25519") as refused:
            read(path)
        assert "openssl genpkey" in refused.value.hint


def test_public_and_private_are_told_apart(keys):
    with pytest.raises(InputDataError, match="holds a public key"):
        store.read_private_key(keys[0][1])
    with pytest.raises(InputDataError, match="holds a private key") as refused:
        store.read_public_key(keys[0][0])
    assert "-pubout" in refused.value.hint


@pytest.mark.parametrize("read", [store.read_private_key, store.read_public_key])
def test_what_is_no_key_is_refused(read, keys, tmp_path):
    text = keys[0][0].read_text()
    for content in ("", "hello", text[: len(text) // 2], "x" * (1 << 17), "\0\n"):
        (tmp_path / "key").write_text(content)
        with pytest.raises(InputDataError, match="key"):
            read(tmp_path / "key")
    with pytest.raises(NotFoundError):
        read(tmp_path / "none")
    with pytest.raises(StoreError, match="directory"):
        read(tmp_path)


def test_an_encrypted_key_asks_for_its_password(keys, tmp_path):
    locked = tmp_path / "locked.pem"
    openssl("pkey", "-in", keys[0][0], "-aes256", "-passout", "pass:sesame", "-out", locked)
    asked: list[str] = []

    def answer(word: str) -> Callable[[str], str]:
        def ask(prompt: str) -> str:
            asked.append(prompt)
            return word

        return ask

    key = store.read_private_key(locked, answer("sesame"))
    assert store.make_signature(DIGEST, key) == signed(keys[0])
    assert str(locked) in asked[0]
    with pytest.raises(InputDataError, match="password is wrong"):
        store.read_private_key(locked, answer("open"))
    with pytest.raises(InputDataError, match="encrypted"):
        store.read_private_key(locked)
    store.read_private_key(keys[0][0], answer("unused"))  # nobody is asked about a key that is not
    assert len(asked) == 2


def test_without_the_package_it_is_said_what_to_install(keys, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.exceptions", None)
    readers: list[Callable[[Path], object]] = [store.read_private_key, store.read_public_key]
    for read, path in zip(readers, keys[0], strict=True):
        with pytest.raises(NotFoundError, match="cryptography is not installed") as refused:
            read(path)
        assert refused.value.hint == "Install it: pip install cryptography"
