"""Which arrays an artifact holds, how large they may be, and the digest that identifies them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skillctl.store.errors import Refusal
from skillctl.store.migrations import FORMAT_VERSION, mark_of

META = "meta.json"
MAX_ARRAY_BYTES = 32 << 20
MAX_TOTAL_BYTES = 128 << 20

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """Element type (NumPy, little-endian), the names of the lengths of an array, and its first format."""

    dtype: str
    lengths: tuple[str, ...]
    since: int = 1

    def nbytes(self, shape: tuple[int, ...]) -> int:
        """Size of an array of this type and shape; Python integers do not overflow."""
        return math.prod(shape) * np.dtype(self.dtype).itemsize


# B bytes of metadata; K components, M density components and L leaves of the skill tree, stacked from left
# to right; d dimensions, c of them a position; D demonstrations with N samples altogether; S learned shears
# of J bumps each; R components of the regions of all parts; G golden
# motions of T states. Lengths of one name are equal.
ARRAYS: dict[str, ArraySpec] = {
    META: ArraySpec("<u1", ("B",)),
    "model/priors": ArraySpec("<f8", ("K",)),
    "model/means": ArraySpec("<f8", ("K", "d")),
    "model/covariances": ArraySpec("<f8", ("K", "d", "d")),
    "model/system_matrices": ArraySpec("<f8", ("K", "d", "d")),
    "model/residual_covariances": ArraySpec("<f8", ("K", "d", "d")),
    "model/attractors": ArraySpec("<f8", ("L", "d")),
    "model/lyapunov": ArraySpec("<f8", ("L", "d", "d")),
    "model/density_priors": ArraySpec("<f8", ("M",)),
    "model/density_means": ArraySpec("<f8", ("M", "d")),
    "model/density_covariances": ArraySpec("<f8", ("M", "d", "d")),
    "demonstrations/positions": ArraySpec("<f8", ("N", "d")),
    "demonstrations/times": ArraySpec("<f8", ("N",)),
    "demonstrations/offsets": ArraySpec("<i8", ("D+1",)),
    "demonstrations/part": ArraySpec("<i8", ("D",)),
    "coordinates/linear": ArraySpec("<f8", ("L", "c", "c"), since=2),
    "coordinates/directions": ArraySpec("<f8", ("S", "c"), since=2),
    "coordinates/firsts": ArraySpec("<f8", ("S",), since=2),
    "coordinates/spacings": ArraySpec("<f8", ("S",), since=2),
    "coordinates/coefficients": ArraySpec("<f8", ("S", "J", "c"), since=2),
    "coordinates/leaf": ArraySpec("<i8", ("S",), since=2),
    "regions/priors": ArraySpec("<f8", ("R",), since=2),
    "regions/means": ArraySpec("<f8", ("R", "d"), since=2),
    "regions/covariances": ArraySpec("<f8", ("R", "d", "d"), since=2),
    "regions/part": ArraySpec("<i8", ("R",), since=2),
    "golden/times": ArraySpec("<f8", ("T",), since=2),
    "golden/states": ArraySpec("<f8", ("G", "T", "d"), since=2),
}
# Each is present as a whole, or absent: no leaf keeps demonstrations; all leaves move in the measured state;
# position densities decide which part acts; no motions were recorded.
OPTIONAL_GROUPS = {"demonstrations", "coordinates", "regions", "golden"}
DERIVED = "golden/"  # follows from the rest but for rounding, so it is no part of the skill's identity

MAX_LENGTHS = {
    "B": 1 << 16,
    "K": 4096,
    "M": 4096,
    "L": 256,
    "d": 64,
    "c": 64,
    "D": 4096,
    "D+1": 4097,
    "N": 1 << 22,
    "S": 4096,
    "J": 64,
    "R": 1 << 14,
    "G": 64,
    "T": 1024,
}


def members(group: str, version: int) -> set[str]:
    """Return the names that a format version knows in a group, "" being the root."""
    prefix = f"{group}/" if group else ""
    return {
        path.removeprefix(prefix).split("/")[0]
        for path, spec in ARRAYS.items()
        if path.startswith(prefix) and spec.since <= version
    }


def require_layout(shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise Refusal unless all shapes agree with each other and with the limits."""
    found: dict[str, int] = {}
    total = 0
    for path, shape in shapes.items():
        spec = ARRAYS[path]
        if len(shape) != len(spec.lengths):
            raise Refusal(f"/{path}: expected {len(spec.lengths)} axes, found {len(shape)}")
        for length, size in zip(spec.lengths, shape, strict=True):
            if not 1 <= size <= MAX_LENGTHS[length]:
                raise Refusal(f"/{path}: {length} = {size} is not within 1 to {MAX_LENGTHS[length]}")
            if found.setdefault(length, size) != size:
                raise Refusal(f"/{path}: {length} is {size} here and {found[length]} elsewhere")
        if spec.nbytes(shape) > MAX_ARRAY_BYTES:
            raise Refusal(f"/{path}: larger than {MAX_ARRAY_BYTES >> 20} MiB")
        total += spec.nbytes(shape)
    if total > MAX_TOTAL_BYTES:
        raise Refusal(f"all arrays together are larger than {MAX_TOTAL_BYTES >> 20} MiB")
    if "D" in found and found["D+1"] != found["D"] + 1:
        raise Refusal(f"/demonstrations/offsets: D+1 is {found['D+1']}, but D is {found['D']}")


def content_digest(arrays: Mapping[str, Array], version: int = FORMAT_VERSION) -> str:
    """Return ``sha256:…`` over path, type, shape and bytes of every array but derived ones: the identity.

    It does not depend on how HDF5 lays the arrays out in a file, but on the format they are written in.
    """
    digest = hashlib.sha256(mark_of(version) + b"\n")
    for path in sorted(path for path in arrays if not path.startswith(DERIVED)):
        spec = ARRAYS[path]
        array = np.ascontiguousarray(arrays[path], dtype=spec.dtype)
        shape = ",".join(map(str, array.shape))
        digest.update(f"/{path} {spec.dtype} {shape}\n".encode("ascii"))
        digest.update(array.tobytes())
    return f"sha256:{digest.hexdigest()}"
