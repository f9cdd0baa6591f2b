"""Judgement of one recording before it is learned: one function for each kind of fault.

A fault has a sentence that names file and place. A small one becomes a warning that is kept in the skill; a
large one is refused unless the user accepts faults of its kind. All limits are shares of what the recording
itself shows, so that they hold in any unit and at any rate. They were tuned on the 30 LASA motions, on
recordings of guided arms, and on copies of these with faults put in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from skillctl.arrays import BoolArray, FloatArray, IntArray
from skillctl.demonstrations.faults import NOTICED, REFUSED, Fault
from skillctl.geometry import extent, segment_lengths

FEWEST = 8  # samples; shorter recordings have no usual pace
WINDOW = 9  # steps before and after; their medians are the pace there, even if four of them are wild
LEAP = 10.0  # a leap covers this many times more than a step at the pace around it,
LEAP_SHARE = 0.02  # and this share of the extent
RETURN = 0.5  # a leap is taken back if what remains of it is shorter than this share
ONWARD = 0.7  # cosine between a leap and the motion that it goes on with: samples are missing there
WILD = 5  # samples at an end that may be wild; more are a motion of their own
HELD = 3  # equal samples may repeat the last one received,
HELD_LEAP = 2.5  # if the next step is this many times longer than steps at the pace around it,
STOP = 0.5  # or, at the end, if the motion was still at this share of its fastest pace
PAUSE = 3.0  # a step in time that is this many times longer than the median is a gap
STILL = 0.1  # a hand slower than this share of its median pace rests
QUARTER = 90.0  # [deg]: jumps of the orientation are shares of this if the hand turns by less
CUT = 0.2  # of the fastest pace: a faster motion that is lost for good has no end


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """A recording that is being judged: times (T,) [s] and positions (T, d).

    Attributes:
        label: File, without its folder, and part: what is kept in a skill names no folders.
        unit: Of a position.
        where: Names a sample of the file.
        samples: Which samples of the file are left, (T,).
        least: Extent by which it is judged if its own is less.
    """

    label: str
    unit: str
    where: Callable[[int], str]
    samples: IntArray
    times: FloatArray
    positions: FloatArray
    least: float = 0.0

    def place(self, sample: int) -> str:
        """Return where a sample that is left stands in the file."""
        return self.where(int(self.samples[sample]))

    def without(self, lost: BoolArray) -> Track:
        """Return the track without some of its samples."""
        kept = ~lost
        return replace(
            self, samples=self.samples[kept], times=self.times[kept], positions=self.positions[kept]
        )

    def backwards(self) -> Track:
        """Return the track from its last sample to its first."""
        return replace(
            self,
            samples=self.samples[::-1],
            times=self.times[-1] - self.times[::-1],
            positions=self.positions[::-1],
        )

    @property
    def gaps(self) -> BoolArray:
        """Which steps (T − 1,) take much longer than usual."""
        steps = np.diff(self.times)
        return np.asarray(steps > PAUSE * np.median(steps))

    @property
    def paces(self) -> FloatArray:
        """Way per usual step of time, (T − 1,); a hurried clock does not raise it."""
        steps = np.diff(self.times)
        return segment_lengths(self.positions) / np.maximum(steps / np.median(steps), 1.0)

    @property
    def around(self) -> FloatArray:
        """Pace of the motion around each step, (T − 1,), and at least the median of all that move."""
        paces = self.paces
        medians = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(paces, WINDOW), WINDOW), axis=1)
        moving = paces[paces > 0]
        usual = float(np.median(moving)) if moving.size else 0.0
        return np.maximum(np.maximum(medians[: len(paces)], medians[WINDOW + 1 :]), usual)

    @property
    def onward(self) -> BoolArray:
        """Which steps (T − 1,) have about the direction of the motion before and after them."""
        last = len(self.times) - 1
        index = np.arange(last)
        before = self.positions[:-1] - self.positions[np.maximum(index - WILD, 0)]
        after = self.positions[np.minimum(index + 1 + WILD, last)] - self.positions[1:]
        steps = np.diff(self.positions, axis=0)
        cosines = [
            np.sum(steps * way, axis=1) - ONWARD * _lengths(steps) * _lengths(way) for way in (before, after)
        ]
        return np.asarray(np.minimum(*cosines) >= 0)

    @property
    def fastest(self) -> float:
        """The pace that only one step in twenty exceeds."""
        return float(np.percentile(self.paces, 95))

    @property
    def size(self) -> float:
        """Extent of the motion without single wild samples."""
        windows = np.lib.stride_tricks.sliding_window_view(self.positions, 5, axis=0)
        return max(extent(np.median(windows, axis=-1)), self.least)

    @property
    def leaps(self) -> BoolArray:
        """Which steps (T − 1,) leap, as no hand does: far in one step, or to and fro."""
        steps, size = np.diff(self.positions, axis=0), self.size
        lengths = _lengths(steps)
        far = lengths > NOTICED * size
        turned = np.append((steps[1:] * steps[:-1]).sum(axis=1) < 0, False) & far & np.append(far[1:], False)
        fro = turned | np.append(False, turned[:-1])
        return np.asarray(fro | ((self.paces > LEAP * self.around) & (lengths > LEAP_SHARE * size)))


def judge_recording(track: Track) -> tuple[Track, list[Fault]]:
    """Return a recording without lost samples and skips of its clock, and its faults."""
    if len(track.times) < FEWEST or not np.isfinite(track.positions).all() or track.size == 0:
        return track, []
    whole, found = track, []
    for lost_of, words in LOSSES:
        lost = lost_of(track)
        if lost.any() and np.count_nonzero(~lost) >= FEWEST:
            found.append(_told(track, lost, words))
            track = track.without(lost)
    faults = [*_jumps(track), *_dropouts(whole, track, found)]
    track, skips = _steady(replace(track, times=track.times - track.times[0]))
    return track, [*faults, *skips]


def judge_turning(track: Track, quaternions: FloatArray) -> tuple[BoolArray, list[Fault]]:
    """Return which samples of a recording have a wild orientation, and the faults of its orientations.

    Twice the quaternions are judged like positions in R⁴: neighbours lie about their angle apart.

    Args:
        track: The recording.
        quaternions: Its orientations, without changes of sign, (T, 4).
    """
    degrees = np.rad2deg(2 * quaternions)
    turning = replace(
        track, label=f"{track.label}, orientation", unit="deg", positions=degrees, least=QUARTER
    )
    lost = np.zeros(len(degrees), dtype=bool)
    faults: list[Fault] = []
    if len(degrees) < FEWEST:
        return lost, faults
    wild = _aside(turning)
    if wild.any() and np.count_nonzero(~wild) >= FEWEST:
        sentence = f"{turning.label}: {_told(turning, wild, LOSSES[1][1])}."
        faults.append(Fault("dropouts", bool(wild.mean() > REFUSED), sentence))
        lost, turning = wild, turning.without(wild)
    return lost, [*faults, *_jumps(turning)]


# ------------------------------------------------------------------------------- samples that were lost


def _zeros(track: Track) -> BoolArray:
    """Return which samples are exactly zero though the motion is elsewhere: a tracker that sees nothing."""
    zero = (track.positions == 0).all(axis=1)
    lost = np.zeros_like(zero)
    if zero.any() and np.count_nonzero(~zero) >= FEWEST:
        rest = track.without(zero)
        far = max(LEAP_SHARE * rest.size, PAUSE * rest.fastest)
        for first, last in _runs(zero):
            beside = track.positions[[i for i in (first - 1, last) if 0 <= i < len(zero)]]
            lost[first:last] = _lengths(beside).min() > far
    return np.asarray(lost)


def _aside(track: Track) -> BoolArray:
    """Return which samples lie between a leap and one that takes it back, or beyond a leap at either end.

    Leaps cut the recording into pieces. From the longest on, a piece belongs to the motion if it goes on
    where the motion was; those in between do not.
    """
    lost = np.zeros(len(track.times), dtype=bool)
    cuts = [0, *(np.flatnonzero(track.leaps) + 1).tolist(), len(lost)]
    pieces = list(pairwise(cuts))
    moves = np.append(segment_lengths(track.positions) > 0, False)
    longest = max(range(len(pieces)), key=lambda i: np.count_nonzero(moves[slice(*pieces[i])]))
    _lose_aside(track.positions, pieces[longest:], lost)
    backwards = [(len(lost) - last, len(lost) - first) for first, last in pieces[longest::-1]]
    _lose_aside(track.positions[::-1], backwards, lost[::-1])
    return lost


def _lose_aside(positions: FloatArray, pieces: list[tuple[int, int]], lost: BoolArray) -> None:
    """Mark the pieces that leave a motion, which begins with the first of them; each is (first, end)."""
    while len(pieces) > 1:
        here = positions[pieces[0][1] - 1]
        out = np.linalg.norm(positions[pieces[1][0]] - here)
        for index in range(2, min(len(pieces), 50)):
            there, before = positions[pieces[index][0]], positions[pieces[index - 1][1] - 1]
            if np.linalg.norm(there - here) < RETURN * min(out, np.linalg.norm(there - before)):
                break
        else:
            rest = positions[pieces[1][0] : pieces[-1][1]]
            index = len(pieces) if len(rest) <= WILD or (rest == rest[0]).all() else 1
        lost[pieces[0][1] : pieces[index - 1][1]] = True
        pieces = pieces[index:]


def _held(track: Track) -> BoolArray:
    """Return which samples repeat the last one received, before the recorder catches up with the motion."""
    same = np.append((np.diff(track.positions, axis=0) == 0).all(axis=1), False)
    lost = np.zeros_like(same)
    lengths, around = segment_lengths(track.positions), track.around
    for first, last in _runs(same):  # samples first to last are equal
        if last - first + 1 < HELD:
            continue
        if last == len(same) - 1:
            before = track.paces[max(first - WILD, 0) : first]
            held = before.size > 0 and np.median(before) > STOP * track.fastest
        else:
            held = lengths[last] > max(HELD_LEAP * around[last], LEAP_SHARE * track.size)
        lost[first + (first > 0) : last + 1] |= held
    return lost


LOSSES: tuple[tuple[Callable[[Track], BoolArray], str], ...] = (
    (_zeros, "is exactly zero|are exactly zero"),
    (_aside, "jumps aside|jump aside"),
    (_held, "repeats the one before|repeat the one before"),
)


def _dropouts(whole: Track, rest: Track, found: Sequence[str]) -> Iterator[Fault]:
    """Yield the fault of a recording that lost samples, or has none on a long way."""
    holes = np.where(rest.gaps | (rest.leaps & rest.onward), segment_lengths(rest.positions), 0.0)
    widest = int(np.argmax(holes))
    share = holes[widest] / rest.size
    lost = 1 - len(rest.times) / len(whole.times)
    pace, missing = float(np.median(rest.paces[-WILD:])), int(whole.samples[-1] - rest.samples[-1])
    cut = pace > CUT * rest.fastest and pace * missing > NOTICED * rest.size
    words = [*found]
    if share > NOTICED:
        words.append(
            f"there are no samples on {holes[widest]:.3g} {rest.unit} of the way, {share:.0%} of the extent, "
            f"after {rest.place(widest)}"
        )
    if cut:
        words.append(f"its end is lost: it is still moving at {rest.place(len(rest.times) - 1)}")
    if words:
        severe = bool(cut or share > REFUSED or lost > REFUSED)
        yield Fault("dropouts", severe, f"{rest.label}: {'; '.join(words)}.")


def _told(track: Track, lost: BoolArray, words: str) -> str:
    """Return how many samples are lost, why, and where the one is that lies farthest off the motion."""
    rest = track.without(lost)
    at = track.times[lost]
    motion = np.stack([np.interp(at, rest.times, column) for column in rest.positions.T], axis=1)
    off = _lengths(track.positions[lost] - motion)
    farthest = int(np.flatnonzero(lost)[np.argmax(off)])
    first, end = next(run for run in _runs(lost) if run[0] <= farthest < run[1])
    where = track.place(first) if end == first + 1 else f"{track.place(first)} to {track.place(end - 1)}"
    count = len(at)
    what = f"{count} sample{'s' if count > 1 else ''} {words.split('|')[count > 1]}"
    return f"{what}, up to {off.max():.3g} {track.unit} off the motion at {where}, left out"


# ------------------------------------------------------------------------------- several motions, clocks


def _jumps(track: Track) -> Iterator[Fault]:
    """Yield the fault of a recording that leaps back to its start, or elsewhere for good."""
    lengths, leaps = segment_lengths(track.positions), track.leaps
    to_start = np.linalg.norm(track.positions[1:] - track.positions[0], axis=1)
    back = (leaps | (track.gaps & (lengths > REFUSED * track.size))) & (to_start < RETURN * lengths)
    aside = leaps & ~track.onward
    if back.any():
        at, count = int(np.argmax(back)), int(np.count_nonzero(back)) + 1
        far = f"{lengths[at]:.3g} {track.unit}, back to its start"
        what = f"it holds {count} demonstrations, which a column demo can tell apart"
    elif aside.any():
        at = int(np.argmax(np.where(aside, lengths, 0.0)))
        far = f"{lengths[at]:.3g} {track.unit}, {lengths[at] / track.size:.0%} of the extent"
        what = "it goes on from there"
    else:
        return
    severe = bool(back.any() or lengths[at] > REFUSED * track.size)
    yield Fault("jumps", severe, f"{track.label}: it jumps by {far}, at {track.place(at + 1)}; {what}.")


def _steady(track: Track) -> tuple[Track, list[Fault]]:
    """Return the track without skips of its clock, and the fault that it had them.

    While the clock skips, the hand covers no more than in a usual step, though it moves before and after.
    """
    steps, lengths, around = np.diff(track.times), segment_lengths(track.positions), track.around
    moving = lengths[lengths > 0]
    pace_before = np.append(np.inf, lengths[:-1])
    pace_after = np.append(lengths[1:], np.inf)
    moves = np.minimum(pace_before, pace_after) > STILL * np.median(moving) if moving.size else False
    skips = track.gaps & (np.diff(track.samples) == 1) & (lengths < PAUSE * around) & moves
    if not skips.any():
        return track, []
    usual = float(np.median(steps))
    at = int(np.argmax(np.where(skips, steps, 0.0)))
    total = float(steps[skips].sum())
    steady = replace(track, times=np.append(0.0, np.cumsum(np.where(skips, usual, steps))))
    sentence = (
        f"{track.label}: the clock jumps by {steps[at]:.3g} s after {track.place(at)}, while the motion goes "
        f"on as before; the usual step of {usual:.3g} s is taken for it."
    )
    return steady, [Fault("clock", bool(total > REFUSED * steady.times[-1]), sentence)]


def _lengths(steps: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(steps, axis=1))


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return (first, end) of each row of neighbours that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
