"""Demonstrations whose files hold the joints of an arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from skillctl.demonstrations.arm import RecordedArm
from skillctl.demonstrations.files import sha256_of
from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reader import InputFile, ReadResult
from skillctl.usecases.options import Robot


def read_of(robot: Robot, reading: Reading, paths: Sequence[Path]) -> ReadResult:
    """Return the demonstrations in files: of the hand if they hold an arm's joints, whose file is a source.

    Raises:
        NotFoundError: There is no such arm or file, or PyBullet is not installed.
        UsageError: ``robot.tip`` does not fit the arm, or there is none.
        InputDataError: The arm's file or a recording is unusable.
    """
    read = reading.read(paths, arm=recorded_arm(robot))
    files = tuple(InputFile(path, sha256_of(path), "urdf") for path in robot.files)
    return replace(read, sources=(*read.sources, *files))


def recorded_arm(robot: Robot) -> RecordedArm | None:
    """Return the arm that was recorded, None if positions were."""
    if robot.arm is None:
        return None
    from skillctl.simulation.forward import hand_positions, joint_names  # late: they need PyBullet
    from skillctl.simulation.urdf import find_arm

    model = find_arm(robot.arm, robot.tip, packages=robot.package)
    return RecordedArm(
        name=model.name,
        hand=model.tip_link,
        joints=joint_names(model),
        lower=tuple(model.lower),
        upper=tuple(model.upper),
        positions=partial(hand_positions, model),
    )
