"""Memory: how much a process may still take, and whether that is enough.

The standard library and two files of the kernel say it. Psutil, the usual package, knows neither the limit of
a control group (a container's) nor that of an address space (``ulimit -v``).
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from skillctl.errors import ResourceError

SHARE = 0.8  # of what there is: a computation that is estimated to take more is refused
START = 768 * 2**20  # [bytes] of address space, with less the libraries may end the process as they start
WORKERS = "SKILLCTL_WORKERS"  # environment variable: how many processes share the machine's memory
KINDS = {  # of control groups, by their controllers: limit, what is used, and what of that is a cache
    "": ("memory.max", "memory.current", "inactive_file"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
MEMINFO, SELF, GROUPS = Path("/proc/meminfo"), Path("/proc/self"), Path("/sys/fs/cgroup")


def available() -> float:
    """Return how much this process may still take, [bytes]; infinity where nothing says it.

    That is the least of what the machine has free, what is left of the limit of each control group around
    this process (both shared by the workers of ``--jobs``), and what is left of its own address space.
    """
    shared = min([_free(), *_left_of_groups()]) / int(os.environ.get(WORKERS, "1"))
    return max(0.0, min(shared, _address_space() - _number(SELF / "status", r"VmSize:\s+(\d+) kB", 0) * 1024))


def require(needed: float, what: str, hint: str) -> None:
    """Raise ResourceError if a computation is estimated to take more than ``SHARE`` of what is available.

    Args:
        needed: The estimate, [bytes].
        what: The computation, as the sentence begins: ``This fit``.
        hint: How to make it smaller.
    """
    if needed > SHARE * (there := available()):
        raise ResourceError(
            f"{what} needs about {_shown(needed)} of memory; {_shown(there)} are free, of which it may use "
            f"{SHARE:.0%}.",
            hint=hint,
        )


def require_start() -> None:
    """Raise ResourceError if the address space is limited to less than the libraries need to start."""
    if (limit := _address_space()) < START:
        raise ResourceError(
            f"the memory of this process is limited to {_shown(limit)}; skillctl needs {_shown(START)}.",
            hint="Raise the limit: ulimit -v unlimited",
        )


def _shown(size: float) -> str:
    return f"{size / 2**30:.2g} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"


def _address_space() -> float:
    import resource

    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    return min(math.inf if limit == resource.RLIM_INFINITY else limit for limit in limits)


def _free() -> float:
    return _number(MEMINFO, r"MemAvailable:\s+(\d+) kB", math.inf) * 1024


def _left_of_groups() -> list[float]:
    """Return what is left of the limit of each control group that this process is in, of either version."""
    try:
        lines = (SELF / "cgroup").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    left = []
    for _, controllers, path in (line.split(":", 2) for line in lines if line.count(":") >= 2):
        version = KINDS.get(controllers)
        if version is not None:
            root = GROUPS / controllers
            inner = root / path.lstrip("/")
            left += [
                _left(group, *version) for group in (inner, *inner.parents) if group.is_relative_to(root)
            ]
    return left


def _left(group: Path, limit: str, used: str, cache: str) -> float:
    most, taken = _number(group / limit, r"(\d+)", math.inf), _number(group / used, r"(\d+)", 0)
    return most - taken + _number(group / "memory.stat", rf"\b{cache} (\d+)", 0)  # the cache makes room


def _number(file: Path, pattern: str, otherwise: float) -> float:
    try:
        found = re.search(pattern, file.read_text(encoding="ascii", errors="replace"))
    except OSError:
        return otherwise
    return otherwise if found is None else float(found[1])
