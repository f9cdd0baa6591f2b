"""The placement of a skill's states in the arm's workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import box
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill, contraction_period
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.options import Plane
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import board_height, cup_middle

PLACED_SIZE = 0.3  # [m], longest side of a motion that had to be scaled
NATURAL_SIZES = (0.15, 0.45)  # [m]: a motion of this size is left as it is
TABLE_HEIGHT = 0.3  # [m], of the xy plane where there is no scene
TABLE_ROOM = 0.06  # [m], of the xy plane above a table or a shelf's upper board
DENSITY_REACH = 2.0  # standard deviations around each component that count as part of the motion
PLANE_RATE = 2.0  # [1/s], at which the hand is drawn to the plane of a 2-D skill
PREVIEW_DURATION, PREVIEW_PERIOD = 20.0, 0.02  # [s], of the rollout that shows how much room a motion needs


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """The similarity x = origin + scale · axes · ξ from a skill's states ξ to workspace positions x [m].

    Poses are placed by their positions; their orientations stay, as last three numbers of a pose (…, 6).

    Attributes:
        axes: Workspace direction of each of the skill's coordinates, orthonormal. Shape (3, d).
        origin: Workspace position of ξ = 0. Shape (3,), [m].
        scale: Workspace metres per metre of the skill.
        plane: Plane of a 2-D skill, None for a 3-D one.
    """

    axes: FloatArray
    origin: FloatArray
    scale: float
    plane: Plane | None

    def to_workspace(self, states: FloatArray) -> FloatArray:
        """Return the positions (…, 3), or poses, of states (…, d)."""
        states, turns = self._split(states)
        return np.concatenate([self.origin + self.scale * states @ self.axes.T, turns], axis=-1)

    def to_state(self, positions: FloatArray) -> FloatArray:
        """Return the states (…, d) of positions (…, 3), along the plane's normal in 2-D, or poses."""
        n = len(self.origin)
        positions, turns = positions[..., :n], positions[..., n:]
        return np.concatenate([(positions - self.origin) @ self.axes / self.scale, turns], axis=-1)

    def lift(self, velocity: FloatArray, position: FloatArray) -> FloatArray:
        """Return the hand's velocity (3,) for a skill's velocity (d,) at a workspace position (3,); or twist.

        Outside the plane of a 2-D skill, a velocity towards the plane is added. It depends only on the
        distance to the plane, which decays exponentially; the skill's own convergence is not changed.
        """
        if self.plane is None:
            velocity, turning = self._split(velocity)
            return np.concatenate([self.scale * self.axes @ velocity, turning])
        offset = position - self.origin
        outside = offset - self.axes @ (self.axes.T @ offset)
        return np.asarray(self.scale * self.axes @ velocity - PLANE_RATE * outside)

    def _split(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and orientations of states (…, d), or the velocities of both."""
        d = self.axes.shape[1]
        return states[..., :d], states[..., d:]


def placements(skill: Skill, model: ArmModel, scenario: Scenario) -> list[Placement]:
    """Return the possible placements of a skill, the best first; there are several only if the scale is free.

    Raises:
        UsageError: The skill's states are not positions in two or three dimensions, in metres.
    """
    d = skill.space.positions
    if skill.space.unit != "m" or d not in (2, 3):
        raise UsageError(
            f"a skill with {d} coordinate{'s' if d > 1 else ''} in {skill.space.unit} cannot be placed in "
            "an arm's workspace.",
            hint="Simulate skills learned from hand positions: 2 or 3 coordinates in metres.",
        )
    if d == 3:
        if scenario.plane is not None:
            raise UsageError("plane: this skill has three coordinates; a plane is for two.")
        origin = np.zeros(3) if scenario.origin is None else np.array(scenario.origin)
        return [Placement(np.eye(3), origin, scenario.scale or 1.0, None)]
    plane = scenario.plane or _named_plane(skill)
    axes = np.eye(3)[:, ["xyz".index(axis) for axis in plane]]
    low, high = _box(skill, scenario)
    if scenario.scale is not None:
        scales = [scenario.scale]
    else:
        scales = [factor * _natural_scale(float((high - low).max())) for factor in (1.0, 0.75, 0.5)]
    if scenario.target == "cup":
        state, point = skill.attractors[0], cup_middle(scenario)
    elif scenario.origin is not None:
        state, point = np.zeros(2), np.array(scenario.origin)
    else:
        state, point = 0.5 * (low + high), _middle(plane, model, scenario)
    return [Placement(axes, point - scale * axes @ state, scale, plane) for scale in scales]


def _named_plane(skill: Skill) -> Plane:
    planes: dict[tuple[str, ...], Plane] = {("x", "z"): "xz", ("y", "z"): "yz"}
    return planes.get(skill.space.names, "xy")


def _natural_scale(size: float) -> float:
    if NATURAL_SIZES[0] <= size <= NATURAL_SIZES[1]:
        return 1.0
    return float(f"{PLACED_SIZE / size:.2g}")  # two digits are easy to repeat by hand


def _box(skill: Skill, scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Return the corners (d,) of the box that holds the skill's motions, in its own coordinates."""
    density = skill.density
    spread = DENSITY_REACH * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    points = [density.means - spread, density.means + spread, skill.attractors]
    if scenario.start is not None:
        longest = contraction_period(skill)  # steps beyond it would lead away from the attractor
        period = PREVIEW_PERIOD if longest == 0 or longest >= PREVIEW_PERIOD else 0.5 * longest
        preview = rollout(skill, [scenario.start], duration=PREVIEW_DURATION, period=period)
        points.append(preview.positions[0])
    return box(np.vstack(points))


def _middle(plane: Plane, model: ArmModel, scenario: Scenario) -> FloatArray:
    """Return the workspace position (3,) around which a 2-D skill is centred, [m]."""
    middle = np.array(model.reach_centre)
    if plane == "xy":
        scene = scenario.scene
        middle[2] = TABLE_HEIGHT if scene is None else board_height(scene, "top") + TABLE_ROOM
    return middle
