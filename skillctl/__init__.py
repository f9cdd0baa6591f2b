"""Robot skills: learn them from demonstrations, make new ones from learned ones, prove them stable.

    from skillctl import learn, merge, combine, verify, load, save

Every name is the use-case behind a command; each is imported when first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skillctl.usecases.combine import combine
    from skillctl.usecases.files import load, save
    from skillctl.usecases.learn import learn
    from skillctl.usecases.merge import merge
    from skillctl.usecases.verify_stability import verify

__version__ = "0.1.0"

__all__ = ["__version__", "combine", "learn", "load", "merge", "save", "verify"]

_HOMES = {
    "combine": "skillctl.usecases.combine",
    "learn": "skillctl.usecases.learn",
    "load": "skillctl.usecases.files",
    "merge": "skillctl.usecases.merge",
    "save": "skillctl.usecases.files",
    "verify": "skillctl.usecases.verify_stability",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
