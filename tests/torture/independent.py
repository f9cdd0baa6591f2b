"""A reader of stores after FORMAT.md alone: h5py, hashlib and nothing of the package that it watches."""

from __future__ import annotations

import hashlib
import io
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MAGIC = bytes.fromhex("89534B494C4C0D0A1A0A")
HEADER = re.compile(
    rb"2 ([1-9][0-9]*) ([0-9a-f]{64})\n(seds|merged|combined|chain) (sha256:[0-9a-f]{64})\n\0+"
)
BEGINNING = 512  # bytes before the body
TYPES = {"<f8", "<i8", "|u1"}
ENTRY = re.compile(r"([1-9][0-9]{0,5})\.(h5|removed)")
TEMPORARY = re.compile(r"\.publishing-[0-9a-f]{16}|\..+\.[0-9a-f]{8}\.tmp")


class Broken(Exception):  # noqa: N818 - a rule of the page
    """A file or a store that is not as FORMAT.md says."""


@dataclass(frozen=True)
class Artifact:
    """What identifies a skill: content digest, kind of its root, and the note of its maker."""

    digest: str
    kind: str
    note: str | None


@dataclass
class Folder:
    """What a store holds of one name; ``given`` is the highest number that a version has or had."""

    versions: dict[int, Artifact] = field(default_factory=dict)
    aliases: dict[str, int] = field(default_factory=dict)
    given: int = 0
    temporary: int = 0


def require(holds: object, what: str) -> None:
    if not holds:
        raise Broken(what)


def read_artifact(data: bytes) -> Artifact:
    """Return what a file of format 2 holds; sections 1 to 4 of the page."""
    require(data.startswith(MAGIC), "the magic is missing")
    header = HEADER.fullmatch(data[len(MAGIC) : BEGINNING])
    require(header, "the first 512 bytes are none of format 2")
    length, checksum, kind, digest = header.groups()
    body = data[BEGINNING:]
    require(len(body) == int(length), f"cut off: {len(body)} of {int(length)} bytes")
    require(hashlib.sha256(body).hexdigest().encode() == checksum, "the body has another SHA-256")
    with h5py.File(io.BytesIO(data), "r") as file:
        require(bytes(file.attrs["format"]) == b"skill-v2", "the attribute says another format")
        arrays = dict(sorted(_datasets(file)))
    require(_digest(arrays) == digest.decode(), "the content has another digest")
    meta = _metadata(arrays.pop("/meta.json").tobytes())
    require(meta["format"] == 2, "meta.json says another format")
    require(meta["skill"]["kind"] == kind.decode(), "meta.json says another kind")
    _require_numbers(arrays)
    return Artifact(digest.decode(), kind.decode(), meta["operation"].get("note"))


def _datasets(group: h5py.Group) -> Iterator[tuple[str, np.ndarray]]:
    for name in group:
        link = group.get(name, getlink=True)
        require(type(link) is h5py.HardLink, f"{name} is no hard link")
        if isinstance(member := group[name], h5py.Group):
            yield from _datasets(member)
        else:
            require(member.dtype.str in TYPES, f"{name} has the type {member.dtype}")
            yield member.name, member[()]


def _digest(arrays: dict[str, np.ndarray]) -> str:
    content = hashlib.sha256(b"skill-v2\n")
    for path, array in arrays.items():  # in the order of the paths
        if path.startswith("/golden/"):
            continue
        shape = ",".join(map(str, array.shape))
        content.update(f"{path} <{array.dtype.str[1:]} {shape}\n".encode("ascii"))
        content.update(np.ascontiguousarray(array).tobytes())
    return f"sha256:{content.hexdigest()}"


def _metadata(text: bytes) -> dict[str, Any]:
    meta: dict[str, Any] = json.loads(text)
    one_form = json.dumps(meta, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    require(one_form.encode("ascii") == text, "meta.json has not the one form that writers use")
    return meta


def _require_numbers(arrays: dict[str, np.ndarray]) -> None:
    for path, array in arrays.items():
        require(array.size and np.isfinite(array).all(), f"{path} is empty, or not finite")
    components, dimension = arrays["/model/means"].shape
    for name in ("covariances", "system_matrices", "residual_covariances"):
        require(arrays[f"/model/{name}"].shape == (components, dimension, dimension), f"shape of {name}")
    require(arrays["/model/priors"].shape == (components,), "shape of priors")
    require((arrays["/model/priors"] > 0).all(), "a prior is not positive")
    if "/demonstrations/offsets" in arrays:
        offsets, samples = arrays["/demonstrations/offsets"], arrays["/demonstrations/positions"]
        require((np.diff(offsets) > 0).all() and offsets[-1] == len(samples), "offsets of demonstrations")


def read_store(root: Path) -> dict[str, Folder]:
    """Return all that a store holds, by name; section 6 of the page. Nobody may be writing to it."""
    if not root.is_dir():
        return {}
    return {directory.name: _folder(directory) for directory in sorted(root.iterdir())}


def _folder(directory: Path) -> Folder:
    require(directory.is_dir() and not directory.is_symlink(), f"{directory} is no directory")
    folder = Folder()
    for path in directory.iterdir():
        entry = ENTRY.fullmatch(path.name)
        if entry is None:
            known = path.name == "refs.toml" or TEMPORARY.fullmatch(path.name)
            require(known, f"{path} is nothing that the page describes")
            folder.temporary += path.name != "refs.toml"
            continue
        number = int(entry[1])
        folder.given = max(folder.given, number)
        if entry[2] == "removed":
            require(path.stat().st_size == 0, f"{path} is not empty")
            continue
        require(path.stat().st_mode & 0o777 == 0o444, f"{path} has the mode {path.stat().st_mode:o}")
        folder.versions[number] = _artifact(path)
    folder.aliases = _aliases(directory / "refs.toml")
    return folder


def _artifact(path: Path) -> Artifact:
    try:
        return read_artifact(path.read_bytes())
    except Exception as error:  # whatever h5py and json say of half a file
        raise Broken(f"{path}: {error}") from error


def _aliases(path: Path) -> dict[str, int]:
    if not path.exists():
        return {}
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    require(set(document) == {"aliases"}, f"{path} holds {sorted(document)}")
    require(all(type(version) is int for version in document["aliases"].values()), f"{path}: no numbers")
    return dict(document["aliases"])
