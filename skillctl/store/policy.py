"""What an HDF5 body may contain; every object is checked before any array is read."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from skillctl.store.errors import Refusal
from skillctl.store.hdf5 import h5py
from skillctl.store.layout import ARRAYS, OPTIONAL_GROUPS, members, require_layout
from skillctl.store.migrations import FORMAT_VERSION, mark_of, require_format

h5a, h5d, h5g, h5l, h5o, h5s, h5t = (
    getattr(h5py, module) for module in ("h5a", "h5d", "h5g", "h5l", "h5o", "h5s", "h5t")
)

STORED_TYPES = {"<f8": h5t.IEEE_F64LE, "<i8": h5t.STD_I64LE, "<u1": h5t.STD_U8LE}
MARK_NAME = b"format"
MAX_MARK_BYTES = 32
MAX_MEMBERS = max(len(members(group, FORMAT_VERSION)) for group in ("", "model"))  # no group has more


def checked_datasets(root: Any, name: str, version: int) -> dict[str, Any]:
    """Return the open datasets of an artifact by path, all of them checked, none of them read.

    Only objects that the format names are opened, so nothing else in a file is ever read.

    Args:
        root: Low-level identifier of the root group.
        name: What the file is called in messages.
        version: The format version that its seal states.

    Raises:
        ArtifactError: A format version that is not read.
        Refusal: Anything the format does not allow.
    """
    _require_mark(root, name, version)
    datasets: dict[str, Any] = {}
    _collect(root, "", {h5o.get_info(root).addr}, datasets, version)
    shapes = {path: _shape(path, dataset) for path, dataset in datasets.items()}
    require_layout(shapes)
    for path, dataset in datasets.items():
        if dataset.get_storage_size() != ARRAYS[path].nbytes(shapes[path]):
            raise Refusal(f"/{path}: the file does not hold all of the array")
    return datasets


def _require_mark(root: Any, name: str, version: int) -> None:
    """The root group carries one attribute, which states the format once more, inside the body."""
    if h5a.get_num_attrs(root) != 1 or not h5a.exists(root, MARK_NAME):
        raise Refusal("the root group must have one attribute, `format`")
    attribute = h5a.open(root, MARK_NAME)
    kind = attribute.get_type()
    fixed_text = isinstance(kind, h5t.TypeStringID) and not kind.is_variable_str()
    if not fixed_text or attribute.shape != () or kind.get_size() > MAX_MARK_BYTES:
        raise Refusal("the attribute `format` must be one short text of fixed length")
    value = np.empty((), f"S{kind.get_size()}")
    attribute.read(value)
    mark = value.tobytes().rstrip(b"\0")
    if mark != mark_of(version):
        stated = re.fullmatch(rb"skill-v(\d{1,9})", mark)
        require_format(name, int(stated[1]) if stated else mark.decode("ascii", "replace"))
        raise Refusal(f"the attribute `format` must be {mark_of(version).decode()}, as its seal states")


def _collect(group: Any, prefix: str, seen: set[int], datasets: dict[str, Any], version: int) -> None:
    for member in _member_names(group, prefix, version):
        path = f"{prefix}{member}"
        kind = h5o.TYPE_DATASET if path in ARRAYS else h5o.TYPE_GROUP
        _require_own_object(group, member, path, kind, seen)
        opened = h5o.open(group, member.encode())
        if h5a.get_num_attrs(opened):
            raise Refusal(f"/{path}: must not have attributes")
        if kind == h5o.TYPE_DATASET:
            datasets[path] = opened
        else:
            _collect(opened, f"{path}/", seen, datasets, version)


def _member_names(group: Any, prefix: str, version: int) -> list[str]:
    """Return the names in a group, which must be those of the format and no others."""
    where, wanted = f"/{prefix}", members(prefix.rstrip("/"), version)
    count = group.get_num_objs()
    found: list[bytes] = []

    def collect(name: bytes) -> bool:
        found.append(name)
        return len(found) > MAX_MEMBERS  # True ends the iteration

    if count <= MAX_MEMBERS:
        group.links.iterate(collect)
    if not len(found) == count <= MAX_MEMBERS:
        raise Refusal(f"{where}: {count} members; the format has {len(wanted)}")
    names = {link.decode("utf-8", "backslashreplace") for link in found}
    if unknown := sorted(names - wanted):
        raise Refusal(f"{where}{unknown[0][:80]}: not part of the format")
    if missing := sorted(wanted - names - OPTIONAL_GROUPS):
        raise Refusal(f"{where}{missing[0]}: missing")
    return sorted(names)


def _require_own_object(group: Any, member: str, path: str, kind: int, seen: set[int]) -> None:
    """Raise unless a member is a hard link to an object of this file that no other link leads to."""
    if group.links.get_info(member.encode()).type != h5l.TYPE_HARD:
        raise Refusal(f"/{path}: a soft, external or user-defined link")
    info = h5o.get_info(group, member.encode())
    if info.type != kind:
        raise Refusal(f"/{path}: must be a {'dataset' if kind == h5o.TYPE_DATASET else 'group'}")
    if info.addr in seen:
        raise Refusal(f"/{path}: the same object as another member")
    seen.add(info.addr)


def _shape(path: str, dataset: Any) -> tuple[int, ...]:
    """Return the shape of a dataset whose bytes lie in this file as they are."""
    created = dataset.get_create_plist()
    if created.get_external_count():
        raise Refusal(f"/{path}: its data would come from another file")
    if created.get_nfilters():
        raise Refusal(f"/{path}: must not be compressed or filtered")
    if created.get_layout() != h5d.CONTIGUOUS:
        raise Refusal(f"/{path}: must be contiguous, not virtual, chunked or compact")
    kind = dataset.get_type()
    if kind.committed() or not kind.equal(STORED_TYPES[ARRAYS[path].dtype]):
        raise Refusal(f"/{path}: elements must be {ARRAYS[path].dtype}")
    space = dataset.get_space()
    if space.get_simple_extent_type() != h5s.SIMPLE:
        raise Refusal(f"/{path}: must be an array")
    shape: tuple[int, ...] = space.get_simple_extent_dims()
    if space.get_simple_extent_dims(maxdims=True) != shape:
        raise Refusal(f"/{path}: must not be extensible")
    return shape
