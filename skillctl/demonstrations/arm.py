"""Recordings of an arm's joints become recordings of its hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.recording import Recording, listed
from skillctl.demonstrations.units import UNITS
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

BEYOND = 0.1  # [rad]; measured joints exceed their limits by less
DEGREES = 2 * np.pi  # an angle larger than a turn is not in radians


@dataclass(frozen=True, eq=False, slots=True)
class RecordedArm:
    """The arm whose joints were recorded; how its hand is found is known elsewhere.

    Attributes:
        name: Of the arm, for messages.
        hand: Link whose position is its hand's.
        joints: Names of its joints, from the base to the hand.
        lower, upper: Their limits, [rad].
        positions: Returns the hand's positions (T, 3) [m], in the frame of the base, for joints (T, n) [rad].
    """

    name: str
    hand: str
    joints: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    positions: Callable[[FloatArray], FloatArray]

    def hand_of(self, recording: Recording) -> Recording:
        """Return the recording of the hand's positions that a recording of the arm's joints stands for.

        Columns with the names of all joints are taken by name, others in their order.

        Raises:
            InputDataError: It does not have one column for each joint, or they are beyond the limits.
        """
        if recording.unit_said and recording.base != "rad":
            raise InputDataError(
                f"{recording.label}: its columns are in {recording.unit}, not angles of joints.",
                hint="Leave out --arm, or choose the joints with --columns.",
            )
        unit = UNITS[recording.unit if recording.base == "rad" else "rad"]
        angles = recording.positions[:, self._order(recording)] / unit.per_base
        self._require_within(recording, angles)
        return replace(
            recording,
            positions=self.positions(angles),
            velocities=None,
            names=AXIS_NAMES,
            unit="m",
            unit_said=True,
            frame="",
            notes=(*recording.notes, f"positions are of {self.hand}, from the base of the arm {self.name}."),
        )

    def _order(self, recording: Recording) -> list[int]:
        names = recording.names or ()
        if set(self.joints) <= set(names):
            return [names.index(joint) for joint in self.joints]
        width = recording.positions.shape[1]
        if width != len(self.joints):
            columns = f" ({listed(names)})" if names else ""
            raise InputDataError(
                f"{recording.label}: {width} columns{columns}, but the arm {self.name} has "
                f"{len(self.joints)} joints ({listed(self.joints)}).",
                hint="Choose one column for each joint, in this order, with --columns.",
            )
        return list(range(width))

    def _require_within(self, recording: Recording, angles: FloatArray) -> None:
        low, high = np.array(self.lower) - BEYOND, np.array(self.upper) + BEYOND
        beyond = (angles < low) | (angles > high)  # false for NaN
        if not beyond.any():
            return
        sample, joint = np.argwhere(beyond)[0]
        hint = "Check the arm, the order of the columns, and --units."
        if np.nanmax(np.abs(angles)) > DEGREES:
            hint = "If these are degrees, say so with --units deg."
        raise InputDataError(
            f"{recording.label}, {recording.where(int(sample))}: joint {printable(self.joints[joint])} is at "
            f"{angles[sample, joint]:.3g} rad, beyond its limits {self.lower[joint]:.3g} to "
            f"{self.upper[joint]:.3g}.",
            hint=hint,
        )
