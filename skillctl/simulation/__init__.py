"""A skill on an arm, in PyBullet: one episode, its figures, its log and its picture.

Importing this room needs neither PyBullet nor Pillow; both are loaded when they are used.
"""

from pathlib import Path

from skillctl.simulation.arm import ARMS
from skillctl.simulation.episode import Episode, Metrics, Outcome, TimeSeries
from skillctl.simulation.options import HANDS, PLANES, SimulationOptions
from skillctl.simulation.recording import write_log
from skillctl.simulation.run import simulate

__all__ = [
    "ARMS",
    "HANDS",
    "PLANES",
    "Episode",
    "Metrics",
    "Outcome",
    "SimulationOptions",
    "TimeSeries",
    "simulate",
    "write_log",
    "write_picture",
]


def write_picture(episode: Episode, path: Path, *, title: str = "") -> None:
    """Write the contact sheet of an episode as PNG; see ``skillctl.simulation.picture``."""
    from skillctl.simulation import picture

    picture.write_picture(episode, path, title=title)
