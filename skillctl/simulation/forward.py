"""Forward kinematics: where the hand of an arm is for given joints."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.bullet import silenced


def joint_names(model: ArmModel) -> tuple[str, ...]:
    """Return the names of the arm's joints in its URDF file, from the base to the hand."""
    with silenced(1), ArmBody(model, 0.0, shapes="none") as body:
        return tuple(body.bullet.getJointInfo(body.body, index)[1].decode() for index in body.indices)


def hand_positions(model: ArmModel, joints: FloatArray) -> FloatArray:
    """Return the positions of the hand, (T, 3) [m] in the frame of the base, for joints (T, n) [rad]."""
    positions = np.empty((len(joints), 3))
    with silenced(1), ArmBody(model, 0.0, shapes="none") as body:
        for row, posture in enumerate(joints):
            body.pose(posture)
            positions[row] = body.hand()[0]
    return positions
