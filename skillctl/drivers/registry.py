"""The drivers by name: those that need nothing else, and those that packages offer as plug-ins."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from skillctl.errors import NotFoundError, did_you_mean

if TYPE_CHECKING:
    from skillctl.drivers.driver import Driver

GROUP = "skillctl.drivers"  # of entry points; ours for robots are in pyproject.toml
OWN = {
    "fake": "skillctl.drivers.fake:FakeArm",
    "pybullet": "skillctl.drivers.pybullet:BulletArm",
    "udp": "skillctl.drivers.udp:UdpRobot",
}


def known() -> dict[str, EntryPoint]:
    """Return where the class of each driver is, by name."""
    own = (EntryPoint(name, place, GROUP) for name, place in OWN.items())
    return {each.name: each for each in (*entry_points(group=GROUP), *own)}


def driver_class(name: str) -> type[Driver]:
    """Return the class of a driver.

    Raises:
        NotFoundError: There is none of that name, or its module does not load.
    """
    drivers = known()
    if name not in drivers:
        hint = (
            did_you_mean(name, list(drivers)) or f"It is {', '.join(sorted(drivers))}, or that of a plug-in."
        )
        raise NotFoundError(f"no driver is called {name!r}.", hint=hint)
    try:
        found: Any = drivers[name].load()
    except (ImportError, AttributeError) as error:
        raise NotFoundError(
            f"the driver {name} cannot be loaded: {error}.",
            hint=f"It comes from {drivers[name].value}; install what that needs.",
        ) from None
    return found  # type: ignore[no-any-return]
