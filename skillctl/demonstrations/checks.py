"""Checks of a recording, which make it a demonstration: refusals, repairs and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.demonstrations.faults import Fault
from skillctl.demonstrations.judgement import Track, judge_recording, judge_turning
from skillctl.demonstrations.orientation import (
    is_still,
    quaternions_of,
    require_half_turn,
    vectors_to_end,
)
from skillctl.demonstrations.recording import GAPS, Recording, uniform_times
from skillctl.demonstrations.sets import judge_together
from skillctl.demonstrations.units import UNITS
from skillctl.errors import InputDataError
from skillctl.geometry import segment_lengths
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.pose import Pose

LARGEST = 1e9  # larger positions are refused, in any unit; sums of squares then cannot overflow
GAP = 3.0  # a step this many times longer than the median is a gap
JITTER = 0.5  # spread of the middle 90 % of steps, against their median
LONG = 600.0  # [s]; one demonstration of a motion is shorter, unless times are not in seconds
EXTENTS = (0.005, 10.0)  # [m]; extents that motions of an arm have
REACH = 2.0  # [m] of most arms


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings about one recording that a user may want to know.

    Attributes:
        label: File and part.
        duplicates: Rows dropped because they repeat the row before, time stamp included.
        gap: Longest step if it is a gap, else 0, [s].
        gap_after: Place of the sample before the gap, in words.
        jitter: Spread of the steps against their median, 0 if even.
        duration: [s].
        estimated_step: Sampling period if it is estimated from the velocities, else 0, [s].
        track: The recording as it was judged.
        faults: Of this recording by itself.
        quaternions: Its orientations x, y, z, w, (T, 4); None if it has none.
        notes: On its orientations.
    """

    label: str
    duplicates: int
    gap: float
    gap_after: str
    jitter: float
    duration: float
    estimated_step: float
    track: Track
    faults: tuple[Fault, ...] = ()
    quaternions: FloatArray | None = None
    notes: tuple[str, ...] = ()


@np.errstate(all="ignore")  # overflow gives values that are not finite, which Demonstration refuses
def prepare(
    recording: Recording, *, dt: float | None, scale: float, reverse: bool = False
) -> tuple[Demonstration, Findings]:
    """Return the demonstration in a recording, and the findings about it.

    Args:
        recording: As read.
        dt: Sampling period where the recording has no times, [s].
        scale: Factor on positions and velocities, after the conversion to metres.
        reverse: Whether the demonstration is the recording backwards; it is judged as it was recorded.

    Raises:
        InputDataError: Values are not finite, time stamps repeat or go back, there are no times, only
            one point, or no motion; an orientation is none, or lies half a turn or more from the last one.
            The message gives file and place.
    """
    _require_finite(recording)
    stamps, estimated = _stamps(recording, dt)
    rows = _fresh_rows(recording, stamps)
    times, positions = stamps[rows], recording.positions[rows]
    _require_increasing(recording, times, rows)
    still = (positions == positions[0]).all() and recording.orientation is None
    if len(rows) < 2 or still:
        raise InputDataError(
            f"{recording.label}: {'one point only' if len(rows) < 2 else 'all points are equal'}; "
            "there is no motion to learn.",
            hint="Check that the recording is whole and the position columns are right, or leave it out.",
        )
    per_unit, unit = UNITS[recording.unit].per_base, recording.base
    times, positions = times - times[0], positions * scale / per_unit
    whole = Track(recording.source, unit, recording.where, rows, times, positions)
    track, faults = judge_recording(whole)
    findings = _findings(recording, whole, estimated)
    quaternions: FloatArray | None = None
    if recording.orientation is not None:
        quaternions, notes = quaternions_of(recording, track.samples)
        wild, turned = judge_turning(track, quaternions)
        track, quaternions, faults = track.without(wild), quaternions[~wild], [*faults, *turned]
        findings = replace(findings, notes=notes)
    if reverse:
        track, quaternions = track.backwards(), None if quaternions is None else quaternions[::-1]
    if quaternions is not None:
        require_half_turn(quaternions, recording.label, track.place)
        findings = replace(findings, quaternions=quaternions)
    demonstration = _demonstration(recording, track, quaternions)
    if recording.velocities is not None:
        velocities = np.array(demonstration.velocities)
        way = -scale if reverse else scale
        velocities[:, : positions.shape[1]] = recording.velocities[track.samples] * way / per_unit
        demonstration = replace(demonstration, velocities=velocities)
    return demonstration, replace(findings, track=track, faults=tuple(faults))


def _demonstration(recording: Recording, track: Track, quaternions: FloatArray | None) -> Demonstration:
    if quaternions is None:
        return Demonstration.from_positions(track.times, track.positions, recording.source)
    states = np.hstack([track.positions, vectors_to_end(quaternions)])
    return Demonstration.from_positions(track.times, states, recording.source, Pose())


def judge(findings: Sequence[Findings]) -> list[Fault]:
    """Return the faults of recordings, each by itself and beside the others; ``demo`` counts them from 0."""
    own = [replace(fault, demo=demo) for demo, found in enumerate(findings) for fault in found.faults]
    turns = [found.quaternions for found in findings if found.quaternions is not None]
    return own + judge_together([found.track for found in findings], turns)


def set_notes(demonstrations: DemonstrationSet, findings: Sequence[Findings]) -> list[str]:
    """Return notes on the demonstrations for the user, a sentence each."""
    notes = []
    total = len(findings)
    if repeated := [f for f in findings if f.duplicates]:
        rows = sum(f.duplicates for f in repeated)
        notes.append(f"{rows} repeated rows were dropped, in {_some(repeated, total)}.")
    if gaps := [f for f in findings if f.gap]:
        worst = max(gaps, key=lambda f: f.gap)
        notes.append(
            f"{_some(gaps, total)} with gaps in time; the longest, {worst.gap:.3g} s, in {worst.label} "
            f"after {worst.gap_after}."
        )
    if uneven := [f for f in findings if f.jitter > JITTER]:
        worst = max(uneven, key=lambda f: f.jitter)
        notes.append(
            f"{_some(uneven, total)} with uneven time steps; worst {worst.label}, where they spread by "
            f"{worst.jitter:.0%} of their median."
        )
    if estimated := [f.estimated_step for f in findings if f.estimated_step]:
        notes.append(
            f"the sampling period follows from the velocities: {1e3 * float(np.median(estimated)):.4g} ms."
        )
    if (longest := max(findings, key=lambda f: f.duration)).duration > LONG:
        notes.append(
            f"{longest.label} lasts {longest.duration:.4g} s; if its times are not seconds, say so in the "
            "header: t_ms."
        )
    notes += [note for found in findings for note in found.notes]
    turns = [found.quaternions for found in findings if found.quaternions is not None]
    if turns and is_still(turns):
        notes.append("the orientation does not change; the skill keeps it.")
    return notes + _shape_notes(demonstrations)


def _some(findings: Sequence[Findings], total: int) -> str:
    return findings[0].label if len(findings) == total == 1 else f"{len(findings)} of {total} demonstrations"


def _shape_notes(demonstrations: DemonstrationSet) -> list[str]:
    notes = []
    extent = demonstrations.extent
    unit = demonstrations.space.unit
    if unit == "m" and extent > EXTENTS[1]:
        likely = [name for name in ("cm", "mm") if extent < REACH * UNITS[name].per_base]
        notes.append(
            f"the motion extends over {extent:.3g} m; if it does not, say the unit, as in --units "
            f"{' or --units '.join(likely or ['mm'])}."
        )
    if unit == "m" and extent < EXTENTS[0]:
        notes.append(f"the motion extends over {extent:.3g} m only; check --units and --scale.")
    return notes


def _require_finite(recording: Recording) -> None:
    """Raise unless all positions and velocities are finite, and all positions are within LARGEST."""
    usable = np.abs(recording.positions) <= LARGEST  # false for NaN, too
    if not usable.all():
        sample, dimension = np.argwhere(~usable)[0]
        value = f"{recording.positions[sample, dimension]:g}"
        raise _refusal(recording, sample, f", {recording.column(dimension)}: {value} is not a position.")
    if recording.velocities is not None and not np.isfinite(recording.velocities).all():
        sample = np.argwhere(~np.isfinite(recording.velocities))[0, 0]
        raise _refusal(recording, sample, ": its velocity is not finite.")


def _refusal(recording: Recording, sample: int, words: str, hint: str = GAPS) -> InputDataError:
    """Return the refusal of one sample."""
    return InputDataError(f"{recording.label}, {recording.where(sample)}{words}", hint=hint)


def _stamps(recording: Recording, dt: float | None) -> tuple[FloatArray, float]:
    """Return the time of each sample, and the period if it is estimated from the velocities."""
    if recording.times is not None:
        return recording.times, 0.0
    estimated = 0.0
    if dt is None and recording.velocities is not None:
        speeds = np.linalg.norm(recording.velocities, axis=1)
        steps = segment_lengths(recording.positions)
        middle = 0.5 * (speeds[1:] + speeds[:-1])
        moving = (middle > 0) & (steps > 0)
        if moving.any():  # the median: a few lost samples make a few long steps
            dt = estimated = float(np.median(steps[moving] / middle[moving]))
    if dt is None:
        raise InputDataError(
            f"{recording.label}: it has no times.",
            hint="Give the sampling period with --dt SECONDS, or say which column is the time, as in "
            "--columns t=NAME.",
        )
    return uniform_times(dt, len(recording.positions)), estimated


def _fresh_rows(recording: Recording, stamps: FloatArray) -> IntArray:
    """Return the samples that do not repeat the one before, time stamp included.

    Recorders sometimes write a row twice. A repeated stamp with another position is an error instead.
    """
    changed = (np.diff(stamps) != 0) | (np.diff(recording.positions, axis=0) != 0).any(axis=1)
    if recording.orientation is not None:
        changed |= (np.diff(recording.orientation.numbers, axis=0) != 0).any(axis=1)
    return np.flatnonzero(np.concatenate([[True], changed]))


def _require_increasing(recording: Recording, times: FloatArray, rows: IntArray) -> None:
    if not np.isfinite(times).all():
        hint = "Remove the row, or leave this demonstration out."
        sample = rows[np.argmin(np.isfinite(times))]
        raise _refusal(recording, sample, ": its time is not finite.", hint)
    steps = np.diff(times)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0)) + 1
        what = "repeats the one before" if steps[at - 1] == 0 else f"follows {times[at - 1]:.15g} s"
        words = f": time stamp {times[at]:.15g} s {what}; time must increase."
        hint = "Remove the row; a table of several demonstrations needs a column demo."
        raise _refusal(recording, rows[at], words, hint)


def _findings(recording: Recording, track: Track, estimated: float) -> Findings:
    """Return what can be said of a recording before it is judged."""
    steps = np.diff(track.times)
    median = float(np.median(steps))
    longest = int(np.argmax(steps))
    low, high = np.percentile(steps, [5, 95])
    return Findings(
        label=recording.label,
        duplicates=len(recording.positions) - len(track.times),
        gap=float(steps[longest]) if steps[longest] > GAP * median else 0.0,
        gap_after=track.place(longest),
        jitter=float((high - low) / median),
        duration=float(track.times[-1]),
        estimated_step=estimated,
        track=track,
    )
