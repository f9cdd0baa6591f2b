"""Ways to spoil an artifact: its bytes anywhere, HDF5's own structures, and the seal in front.

Every function takes a random generator and bytes, and returns other bytes; the same generator gives the same.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from random import Random
from typing import Any

import h5py
import numpy as np

SEAL = 512
Mutation = Callable[[Random, bytes, list[bytes]], bytes]

# ---------------------------------------------------------------------------------------------------------
# Bytes of any file

WORDS = (0, 1, 2, 7, 8, 0xFF, 0x100, 0x7FFF, 0xFFFF, 1 << 31, (1 << 32) - 1, 1 << 62, (1 << 64) - 1)
LENGTHS = (1, 2, 4, 8, 16, 64, 512, 4096)


def spans(rng: Random, data: bytearray) -> tuple[int, int, int]:
    """Return two places and a length that fit into the data."""
    n = min(rng.choice(LENGTHS), len(data))
    return rng.randrange(len(data) - n + 1), rng.randrange(len(data) - n + 1), n


def flip(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    changed = bytearray(data)
    for _times in range(rng.choice((1, 1, 1, 2, 8, 64))):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def overwrite(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    changed = bytearray(data)
    for _times in range(rng.randint(1, 4)):
        size = min(rng.choice((1, 2, 4, 8)), len(changed))
        at = rng.randrange(len(changed) - size + 1)
        word = rng.choice((*WORDS, rng.randrange(len(data)), at, at + 8)) % (1 << 8 * size)
        changed[at : at + size] = word.to_bytes(size, "little")
    return bytes(changed)


def truncate(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    return data[: rng.choice((rng.randrange(len(data)), len(data) - rng.randint(1, 64)))]


def extend(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    n = rng.randint(1, 4096)
    return data + rng.choice((bytes(n), rng.randbytes(n), data[-n:]))


def zero_block(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    changed = bytearray(data)
    at, _to, n = spans(rng, changed)
    changed[at : at + n] = bytes([rng.choice((0, 0, 0xFF))]) * n
    return bytes(changed)


def swap_blocks(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    changed = bytearray(data)
    i, j, n = spans(rng, changed)
    changed[i : i + n], changed[j : j + n] = changed[j : j + n], changed[i : i + n]
    return bytes(changed[: len(data)])


def copy_block(rng: Random, data: bytes, others: list[bytes]) -> bytes:
    """Copy a block over another, from this file or from another artifact."""
    changed, source = bytearray(data), rng.choice((data, rng.choice(others)))
    i, _, n = spans(rng, changed)
    j = rng.randrange(max(1, len(source) - n + 1))
    changed[i : i + n] = source[j : j + n].ljust(n, b"\0")
    return bytes(changed)


def insert_or_delete(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    changed = bytearray(data)
    i, j, n = spans(rng, changed)
    if rng.random() < 0.5:
        changed[i:i] = changed[j : j + n]
    else:
        del changed[i : i + n]
    return bytes(changed)


def splice(rng: Random, data: bytes, others: list[bytes]) -> bytes:
    """The beginning of one artifact and the end of another."""
    other = rng.choice(others)
    at = rng.randrange(min(len(data), len(other)))
    return data[:at] + other[at:]


def structure_offsets(data: bytes) -> list[int]:
    """Return where HDF5's own structures are: everything behind the seal that is no array."""
    structure = np.ones(len(data), bool)
    structure[:SEAL] = False

    def cover(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            structure[item.id.get_offset() : item.id.get_offset() + item.id.get_storage_size()] = False

    with h5py.File(BytesIO(data)) as body:
        body.visititems(cover)
    return [int(at) for at in np.flatnonzero(structure)]


def structure(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    """Change a few bytes of superblock, headers, trees and heaps; most of them are not zero."""
    changed = bytearray(data)
    offsets = structure_offsets(data)
    used = [at for at in offsets if data[at]]
    for _times in range(rng.choice((1, 1, 2, 4))):
        at = rng.choice(rng.choice((used, used, offsets)))
        changed[at] = rng.choice((0, 1, 0xFF, changed[at] ^ (1 << rng.randrange(8)), rng.randrange(256)))
    return bytes(changed)


# ---------------------------------------------------------------------------------------------------------
# The seal

HEADERS = (
    b"", b"\0", b" ", b"\n", b"-1", b"0", b"1", b"2", b"01", b"1.0", b"99999999999", b"seds", b"merged",
    b"combined", b"chain", b"sha256:", b"\x89SKILL", b"\xff",
)  # fmt: skip


def header(rng: Random, data: bytes, _: list[bytes]) -> bytes:
    """Change words and digits of the lines in front, and keep the 512 bytes."""
    words = data[10:SEAL].rstrip(b"\0").replace(b"\n", b" \n ").split(b" ")
    at = rng.randrange(len(words))
    if rng.random() < 0.5 and words[at]:
        place = rng.randrange(len(words[at]))
        words[at] = (
            words[at][:place] + rng.choice(b"0123456789abcdef").to_bytes(1, "big") + words[at][place + 1 :]
        )
    else:
        words[at] = rng.choice(HEADERS)
    text = b" ".join(words).replace(b" \n ", b"\n")
    return (data[:10] + text).ljust(SEAL, b"\0")[:SEAL] + data[SEAL:]


ANYWHERE: dict[str, Mutation] = {
    mutation.__name__.replace("_", " "): mutation
    for mutation in (
        flip, overwrite, truncate, extend, zero_block, swap_blocks, copy_block, insert_or_delete, splice,
        structure,
    )
}  # fmt: skip
