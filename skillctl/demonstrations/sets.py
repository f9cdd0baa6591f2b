"""Judgement of recordings beside each other: whether they show one motion, which a skill can follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skillctl import rotations
from skillctl.arrays import BoolArray, FloatArray
from skillctl.demonstrations.faults import NOTICED, REFUSED, Fault
from skillctl.demonstrations.judgement import Track
from skillctl.demonstrations.options import Fault as Kind
from skillctl.geometry import extent, path_length, resample_by_arc_length

SCATTER = 3.0  # ends up to this many times as far off as their median scatter like the others
REVERSED = 0.5  # a way is opposite if it lies this many times nearer when reversed
NEAR = 0.02  # of the extent: places as near as this are one place, from which a skill goes on in one way
TURNED = (np.deg2rad(20), np.deg2rad(60))  # apart: noticed and refused; RoboTasks' ends scatter by up to 13°
WAY = 30  # samples of a way by which it is compared
CROSSING = 1 / 3  # of the demonstrations: if as many cross themselves, it is no slip


def judge_together(tracks: Sequence[Track], turns: Sequence[FloatArray] = ()) -> list[Fault]:
    """Return the faults of recordings of one motion beside each other; ``demo`` counts them from 0.

    ``turns`` are their orientations, if they have them: quaternions (T, 4) each.
    """
    size = float(np.median([extent(track.positions) for track in tracks]))
    opposite = _opposite(tracks)
    faults = [
        Fault("directions", True, f"{tracks[i].label} goes the way of the others backwards.", i)
        for i in np.flatnonzero(opposite).tolist()
    ]
    return [*faults, *_apart(tracks, ~opposite, size), *_crossings(tracks), *_turned_apart(tracks, turns)]


def _opposite(tracks: Sequence[Track]) -> BoolArray:
    """Return which recordings go the way of the others backwards: those of the smaller group."""
    ways = np.stack([resample_by_arc_length(track.positions, 30) for track in tracks])
    along, back = (
        np.stack([np.linalg.norm(ways - way, axis=2).mean(axis=1) for way in others])
        for others in (ways, ways[:, ::-1])
    )
    opposite = back < REVERSED * along
    return np.asarray(opposite[np.argmin(opposite.sum(axis=1))])


def _apart(tracks: Sequence[Track], judged: BoolArray, size: float) -> Iterator[Fault]:
    """Yield the recordings that end apart from the others, or once that there is no common end."""
    ends = np.stack([track.positions[-1] for track in tracks])
    away = np.linalg.norm(ends - np.median(ends[judged], axis=0), axis=1)
    usual, unit = float(np.median(away[judged])), tracks[0].unit
    if usual > NOTICED * size:
        worst = int(np.argmax(np.where(judged, away, 0.0)))
        sentence = (
            f"the ends lie up to {away[worst]:.3g} {unit} from their median, {away[worst] / size:.0%} of the "
            f"extent ({tracks[worst].label}); are they demonstrations of one motion to one target?"
        )
        yield Fault("ends", usual > REFUSED * size, sentence, None)
        return
    for i in np.flatnonzero(judged & (away > max(NOTICED * size, SCATTER * usual))).tolist():
        far = f"{away[i]:.3g} {unit} from the others, {away[i] / size:.0%} of the extent"
        sentence = f"{tracks[i].label} ends {far}, at {tracks[i].place(-1)}."
        yield Fault("ends", bool(away[i] > REFUSED * size), sentence, i)


def _turned_apart(tracks: Sequence[Track], turns: Sequence[FloatArray]) -> Iterator[Fault]:
    """Yield the recordings that end turned apart from the others, or turn another way to their end."""
    if len(turns) < 2:
        return
    to_end = [rotations.vectors(rotations.product(rotations.inverse(each[-1]), each)) for each in turns]
    ends = rotations.vectors(np.stack([each[-1] for each in turns]))
    away = rotations.angles(ends, _middle(ends))
    share = np.linspace(0, 1, WAY)
    ways = np.stack([each[np.rint(share * (len(each) - 1)).astype(int)] for each in to_end])
    between = rotations.angles(ways[:, None], ways).mean(axis=2)
    off = between[np.argmin(np.median(between, axis=1))]
    kinds: tuple[tuple[Kind, FloatArray, str], ...] = (
        ("ends", away, "its orientation at the end is {} from the others"),
        ("directions", off, "it turns another way to its end than the others, on average {} from them"),
    )
    for kind, angles, words in kinds:
        for i in np.flatnonzero(angles > TURNED[0]).tolist():
            far = words.format(f"{np.rad2deg(angles[i]):.0f}°")
            yield Fault(kind, bool(angles[i] > TURNED[1]), f"{tracks[i].label}: {far}.", i)


def _middle(vectors: FloatArray) -> FloatArray:
    """Return the one of rotations (n, 3) that is nearest to most others."""
    angles = rotations.angles(vectors[:, None], vectors)
    return np.asarray(vectors[np.argmin(np.median(angles, axis=1))])


def _crossings(tracks: Sequence[Track]) -> Iterator[Fault]:
    """Yield the recordings that come back to a place: from there a skill goes on as it did the first time.

    If many do, the motion is so, and leaving them out is of no help.
    """
    loops = [_loop(track.positions) for track in tracks]
    crossing = [i for i, (size, _) in enumerate(loops) if size > NOTICED]
    large = [i for i in crossing if loops[i][0] > REFUSED]
    often = len(large) >= CROSSING * len(tracks)
    for i in large[:1] if often else crossing:
        track, (size, there) = tracks[i], loops[i]
        at = int(np.argmin(np.linalg.norm(track.positions - there, axis=1)))
        others = f", as do {len(large) - 1} others" if often and len(large) > 1 else ""
        sentence = (
            f"{track.label} crosses its own way at {track.place(at)}, after a loop of {size:.0%} of its "
            f"extent{others}; a skill goes one way from each place and cannot go both."
        )
        yield Fault("crossings", often, sentence, None if often else i)


def _loop(positions: FloatArray) -> tuple[float, FloatArray]:
    """Return the size of the longest loop between two visits of a place, as a share, and the place."""
    path = resample_by_arc_length(positions, 300)
    size, between = extent(path), float(path_length(path)) / (len(path) - 1)
    index = np.arange(len(path))
    near = np.linalg.norm(path[:, None] - path, axis=2) < NEAR * size
    visits = np.argwhere(near & ((index - index[:, None]) * between > NOTICED * size))
    if not len(visits) or size == 0:
        return 0.0, path[0]
    first, second = visits[np.argmax(visits[:, 1] - visits[:, 0])]
    return extent(path[first : second + 1]) / size, path[second]
