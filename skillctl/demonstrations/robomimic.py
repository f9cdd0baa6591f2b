"""Robot data sets in HDF5 files: a group for each demonstration, with observations by name."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from skillctl.demonstrations.features import Features, choose, numbered, offered
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import Recording, listed, uniform_times
from skillctl.errors import InputDataError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
BLOCKS = (0, *(512 * 2**i for i in range(8)))  # places of the signature: a user block may be before it
ALOHA_JOINTS = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate", "gripper")
ANGLES = re.compile(r"qpos|joint|qp_arm")  # observations in radians, in all of LAYOUTS


@dataclass(frozen=True, slots=True)
class Layout:
    """Where a data set keeps its observations.

    Attributes:
        name: Of the project that records so.
        parent: Group of the demonstrations, empty for the root.
        demonstration: Pattern of their names; empty if the whole file is one.
        observations: Group of the observations in a demonstration.
        preferred: Observation that is read unless others are chosen.
        hint: What to do if there are no observations.
    """

    name: str
    parent: str
    demonstration: str
    observations: str
    preferred: str
    hint: str = "Record it again with observations."


LAYOUTS = (
    Layout(
        "robomimic", "data", r"demo_(\d{1,9})", "obs", "robot0_eef_pos",
        "Extract them from the states, with robomimic's script dataset_states_to_obs.py.",
    ),
    Layout(
        "ManiSkill", "", r"traj_(\d{1,9})", "obs", "extra/tcp_pose",
        "Replay it with them: python -m mani_skill.trajectory.replay_trajectory --obs-mode state_dict",
    ),
    Layout("RoboSet", "", r"Trial(\d{1,9})", "data", "qp_arm"),
    Layout("ALOHA", "", "", "observations", "qpos"),
)  # fmt: skip


def recognises(file: File) -> bool:
    """Return whether the content is an HDF5 file."""
    return any(file.content[start : start + len(SIGNATURE)] == SIGNATURE for start in BLOCKS)


def read(file: File) -> list[Recording]:
    """Return the demonstrations in a data set of one of ``LAYOUTS``, in the order of their numbers.

    ``file.columns`` names observations, or numbers in them; they are stacked side by side. The sampling
    period is one over the ``control_freq`` of the environment that a robomimic data set was recorded in, if
    the file gives it.

    Raises:
        InputDataError: The file is damaged or of another layout, lacks an observation, or links to others.

    References:
        Mandlekar et al. 2021, "What Matters in Learning from Offline Human Demonstrations", and the
        description of the dataset structure in robomimic's documentation. Tao et al. 2024, ManiSkill3, and
        the page on demonstrations in its documentation. Zhao et al. 2023, ALOHA: record_episodes.py.
    """
    path = file.path
    likely = list(file.columns or [layout.preferred for layout in LAYOUTS])
    found = file.opened(overview, "HDF5 file", keys=likely)
    layout = next((layout for layout in LAYOUTS if layout.name == found["layout"]), None)
    if layout is None:
        raise InputDataError(
            f"{path}: an HDF5 file of unknown layout (found {listed(found['members']) or 'nothing'}).",
            hint=f"Expected a robomimic dataset: data/demo_0/obs/{LAYOUTS[0].preferred}; or one of "
            f"{', '.join(each.name for each in LAYOUTS[1:])}.",
        )
    if not found["widths"]:
        raise InputDataError(f"{path}: its demonstrations hold no observations.", hint=layout.hint)
    wanted = list(file.columns or [layout.preferred])
    features = {key: _labels(layout, key, width) for key, width in found["widths"].items()}
    _require(wanted, features, found["shapes"], file)
    choice = choose(wanted, features, file, what="observation")
    keys = choice.keys
    stacks = file.opened(matrices, "HDF5 file", layout=layout.name, names=found["names"], keys=keys)
    period = None if found["frequency"] is None else 1 / found["frequency"]
    recordings = []
    for name, stack in stacks.items():
        position, orientation = choice.split(stack, features)
        recordings.append(
            Recording(
                path,
                position,
                times=None if period is None else uniform_times(period, len(stack)),
                names=choice.names,
                part=name,
                unit="rad" if all(ANGLES.search(key) for key, _ in choice.places) else "m",
                taken=choice.taken,
                unused=() if file.columns is not None else choice.left,
                orientation=orientation,
                notes=choice.notes,
            )
        )
    return recordings


def _labels(layout: Layout, key: str, width: int) -> tuple[str, ...]:
    """Return the names of an observation's numbers, as far as the projects say what they are."""
    if layout.name == "ALOHA" and key == layout.preferred:
        if width == len(ALOHA_JOINTS):
            return ALOHA_JOINTS
        if width == 2 * len(ALOHA_JOINTS):
            return tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ALOHA_JOINTS)
    named = numbered(key, width)
    if layout.name == "robomimic" and key.endswith("quat") and width == 4:
        return tuple(f"{name[:-1]}{letter}" for name, letter in zip(named, "xyzw", strict=True))
    if layout.name == "ManiSkill" and key.endswith("pose") and width == 7:
        stem = named[0][:-1]
        return (*named[:3], *(f"{stem}q{letter}" for letter in "wxyz"))
    return named


def _require(wanted: list[str], features: Features, shapes: dict[str, list[int]], file: File) -> None:
    """Refuse observations that are no rows of numbers, and offer others for one that nobody asked for."""
    offer, names = offered(features), listed(list(features))
    for key in wanted:
        if key in shapes:
            shape = tuple(shapes[key])
            raise InputDataError(
                f"{file.path}: the observation '{key}' has the shape {shape}, where positions have (T, d).",
                hint=f"{offer} The others are: {names}.".lstrip(),
            )
    if file.columns is None and wanted[0] not in features:
        raise InputDataError(
            f"{file.path}: there is no observation '{wanted[0]}'.",
            hint=f"{offer} The observations are: {names}.".lstrip(),
        )


def overview(path: str, keys: list[str]) -> dict[str, Any]:
    """Return what a data set holds; runs in the child, so that only the child imports h5py."""
    from skillctl.demonstrations.observations import overview

    return overview(path, LAYOUTS, keys)


def matrices(path: str, layout: str, names: list[str], keys: list[str]) -> dict[str, Any]:
    """Return observations of demonstrations; runs in the child."""
    from skillctl.demonstrations.observations import matrices

    return matrices(path, next(each for each in LAYOUTS if each.name == layout), names, keys)
