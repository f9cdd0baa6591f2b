"""Read HDF5 files of unknown origin: only numbers that are stored in the file itself.

This module runs only in a child process, see ``files.File.opened``. Every link is checked before it is
followed, and every dataset before it is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import prod
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5i, h5l, h5o, h5s, h5t

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import MAX_BYTES
from skillctl.errors import InputDataError, printable

MAX_MEMBERS = 10_000  # of one group
MAX_TEXT = 2**20  # characters of one text
HINT = "Copy what you need into a file of its own, with h5repack or h5py."


@contextmanager
def root_of(path: str) -> Iterator[Any]:
    """Yield the root group of a file while it is open."""
    with h5py.File(path, "r", locking=False) as file:
        yield h5g.open(file.id, b"/")


def members(group: Any) -> list[str]:
    """Return the names in a group.

    Raises:
        InputDataError: More than MAX_MEMBERS.
    """
    if group.get_num_objs() > MAX_MEMBERS:
        raise InputDataError(f"{_named(group)}: more than {MAX_MEMBERS} members.", hint=HINT)
    names: list[bytes] = []
    group.links.iterate(names.append)
    return [name.decode(errors="surrogateescape") for name in names]


def subgroup(group: Any, name: str) -> Any | None:
    """Return a group in a group, or None if there is none of that name.

    Raises:
        InputDataError: A link that may lead elsewhere.
    """
    return _opened(group, name, h5o.TYPE_GROUP)


def array(group: Any, name: str) -> Any | None:
    """Return a dataset in a group, unread: an array of numbers; or None if there is none of that name.

    Raises:
        InputDataError: A link that may lead elsewhere, or a dataset whose data lie elsewhere.
    """
    dataset = _opened(group, name, h5o.TYPE_DATASET)
    if dataset is None:
        return None
    created = dataset.get_create_plist()
    if created.get_external_count() or created.get_layout() == h5d.VIRTUAL:
        raise InputDataError(f"{_named(dataset)}: its data would come from other files.", hint=HINT)
    return dataset if dataset.get_type().get_class() in (h5t.FLOAT, h5t.INTEGER) else None


def require_small(datasets: Iterable[Any]) -> None:
    """Raise InputDataError if datasets claim more than MAX_BYTES together: a header may claim anything."""
    total = 0
    for dataset in datasets:
        total += 8 * prod(dataset.shape)
        if total > MAX_BYTES:
            raise InputDataError(
                f"{_named(dataset)} {dataset.shape}: too large; at most {MAX_BYTES / 2**20:.0f} MiB of "
                "numbers are read from a file.",
                hint=HINT,
            )


def numbers(dataset: Any) -> FloatArray:
    """Return the numbers in a dataset."""
    array = np.empty(dataset.shape)
    dataset.read(h5s.ALL, h5s.ALL, array)
    return array


def text(group: Any, name: str) -> str | None:
    """Return a text attribute of a group, or None if there is no such text."""
    if not h5a.exists(group, name.encode()):
        return None
    kind = h5a.open(group, name.encode()).get_type()
    if kind.get_class() != h5t.STRING or kind.get_size() > MAX_TEXT:
        return None
    value = h5py.Group(group).attrs[name]
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    return value if isinstance(value, str) and len(value) <= MAX_TEXT else None


def _opened(group: Any, name: str, kind: int) -> Any | None:
    raw = name.encode(errors="surrogateescape")
    if not group.links.exists(raw):
        return None
    if group.links.get_info(raw).type != h5l.TYPE_HARD:
        where = f"{_named(group).rstrip('/')}/{printable(name)[:80]}"
        raise InputDataError(
            f"{where}: a soft, external or user-defined link, which is not followed.", hint=HINT
        )
    if h5o.get_info(group, raw).type != kind:
        return None
    return h5o.open(group, raw)


def _named(thing: Any) -> str:
    return printable((h5i.get_name(thing) or b"?").decode(errors="replace"))[:80]
