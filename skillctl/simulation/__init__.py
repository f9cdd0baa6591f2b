"""A skill on an arm, in PyBullet: one episode, its figures, its log and its picture.

Importing this room needs neither PyBullet nor Pillow; both are loaded when they are used.
"""

from skillctl.simulation.arm import ARMS
from skillctl.simulation.episode import (
    OUTCOMES,
    PHASES,
    SUCCESSES,
    Episode,
    Metrics,
    Outcome,
    RefusedError,
    TimeSeries,
)
from skillctl.simulation.recording import encode_log, log_format
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import HANDS, PLANES, Cup, Scenario, Shelf, Table

__all__ = [
    "ARMS",
    "HANDS",
    "OUTCOMES",
    "PHASES",
    "PLANES",
    "SUCCESSES",
    "Cup",
    "Episode",
    "Metrics",
    "Outcome",
    "RefusedError",
    "Scenario",
    "Shelf",
    "Table",
    "TimeSeries",
    "encode_log",
    "log_format",
    "simulate",
]
