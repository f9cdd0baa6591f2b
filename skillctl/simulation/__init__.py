"""A skill on an arm, in PyBullet: one episode, its figures, its log and its picture.

Importing this room needs neither PyBullet nor Pillow; both are loaded when they are used.
"""

from skillctl.simulation.arm import ARMS
from skillctl.simulation.episode import Episode, Metrics, Outcome, TimeSeries
from skillctl.simulation.options import HANDS, PLANES, SimulationOptions
from skillctl.simulation.recording import encode_log
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
    "encode_log",
    "simulate",
]
