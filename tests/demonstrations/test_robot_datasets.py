"""Data sets of robots in HDF5: the layouts of ManiSkill, ALOHA and RoboSet, and what is chosen in them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError

ALOHA = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")


@pytest.fixture
def save_maniskill(tmp_path: Path, curve) -> Callable[..., Path]:
    """Write a file as ManiSkill's RecordEpisode does with --obs-mode state_dict."""

    def save(demos: int = 3, edit: Callable[[h5py.File], None] = lambda file: None) -> Path:
        with h5py.File(tmp_path / "trajectory.h5", "w") as file:
            for index in range(demos):
                motion = curve(samples=10 + index, dimension=3, seed=index)
                group = file.create_group(f"traj_{index}")
                group["actions"] = np.zeros((len(motion) - 1, 8), np.float32)
                for flag in ("terminated", "truncated", "success"):
                    group[flag] = np.zeros(len(motion) - 1, bool)
                group["env_states/articulations/panda"] = np.zeros((len(motion), 31), np.float32)
                agent, extra = group.create_group("obs/agent"), group.create_group("obs/extra")
                agent["qpos"] = np.tile(np.arange(9.0) / 4, (len(motion), 1)) + motion[:, :1]
                agent["qvel"] = np.zeros((len(motion), 9))
                extra["tcp_pose"] = np.hstack([motion, np.tile([0.0, 1, 0, 0], (len(motion), 1))])
                extra["is_grasped"] = np.zeros(len(motion), bool)
            edit(file)
        return tmp_path / "trajectory.h5"

    return save


@pytest.fixture
def save_aloha(tmp_path: Path) -> Callable[..., Path]:
    """Write an episode as ALOHA's record_episodes.py does, with pictures."""

    def save(arms: int = 2, name: str = "episode_0.hdf5") -> Path:
        samples = 12
        with h5py.File(tmp_path / name, "w", rdcc_nbytes=2**21) as root:
            root.attrs["sim"] = False
            observations = root.create_group("observations")
            images = observations.create_group("images")
            images.create_dataset("cam_high", (samples, 48, 64, 3), "uint8", chunks=(1, 48, 64, 3))
            for key in ("qpos", "qvel", "effort"):
                joints = np.arange(7.0 * arms) / 4 + np.linspace(0, 1, samples)[:, None] ** 2
                observations[key] = joints if key == "qpos" else 0 * joints
            root["action"] = np.zeros((samples, 7 * arms))
        return tmp_path / name

    return save


def test_the_hand_of_maniskill_is_read_without_its_orientation(save_maniskill, curve) -> None:
    path = save_maniskill()
    result = read_demonstrations([path], dt=0.05, position_only=True)
    assert [d.source for d in result.demonstrations] == [f"trajectory.h5, traj_{i}" for i in range(3)]
    for index, demonstration in enumerate(result.demonstrations):
        assert (demonstration.positions == curve(samples=10 + index, dimension=3, seed=index)).all()
    assert result.demonstrations.space.names == ("x", "y", "z")
    assert result.demonstrations.space.unit == "m"
    assert result.notes[0] == (
        "the position is tcp_pose_0, tcp_pose_1, tcp_pose_2; left aside: agent/qpos, agent/qvel, "
        "tcp_pose_qw, tcp_pose_qx, tcp_pose_qy, tcp_pose_qz; use --columns to choose others."
    )


def test_joints_are_chosen_by_pattern_and_are_angles(save_maniskill, curve) -> None:
    result = read_demonstrations([save_maniskill()], columns=["qpos_[0-6]"], dt=0.05)
    assert result.demonstrations.space.unit == "rad"
    assert result.demonstrations.space.names == tuple(f"qpos_{i}" for i in range(7))
    first = result.demonstrations.demonstrations[0]
    assert (first.positions == np.arange(7.0) / 4 + curve(samples=10, dimension=3)[:, :1]).all()
    with pytest.raises(InputDataError, match="9 numbers could be the position; which are") as error:
        read_demonstrations([save_maniskill()], columns=["agent/qpos"], dt=0.05)
    assert "--columns" in error.value.hint


def test_recordings_without_observations_say_how_to_get_them(save_maniskill) -> None:
    def flat(file: h5py.File) -> None:
        for group in file.values():
            del group["obs"]

    with pytest.raises(InputDataError, match="its demonstrations hold no observations") as error:
        read_demonstrations([save_maniskill(edit=flat)])
    assert "replay_trajectory" in error.value.hint


def test_one_of_two_arms_is_chosen_without_its_gripper(save_aloha) -> None:
    with pytest.raises(InputDataError, match="12 numbers could be the position") as error:
        read_demonstrations([save_aloha()], dt=0.02)
    assert "'left_*'" in error.value.hint
    assert "right_wrist_rotate" in error.value.hint
    result = read_demonstrations([save_aloha()], columns=["right_*"], dt=0.02)
    assert result.demonstrations.space.names == tuple(f"right_{joint}" for joint in ALOHA)
    assert result.demonstrations.space.unit == "rad"
    (demonstration,) = result.demonstrations
    assert demonstration.positions[0].tolist() == [1.75, 2.0, 2.25, 2.5, 2.75, 3.0]
    assert demonstration.times[1] == 0.02


def test_one_arm_needs_no_choice(save_aloha) -> None:
    result = read_demonstrations([save_aloha(arms=1)], dt=0.02)
    assert result.demonstrations.space.names == ALOHA
    assert "left aside: effort, qvel, gripper;" in result.notes[0]


def test_pictures_do_not_count_against_the_size_of_a_file(save_aloha) -> None:
    path = save_aloha(arms=1)
    with h5py.File(path, "r+") as file:  # 300 MB, as chunks that were never written
        file.create_dataset("observations/images/cam_low", (12, 5000, 5000), "uint8")
        file["observations/images/cam_low"][-1, -1, -1] = 1
    assert path.stat().st_size > 2**28
    assert len(read_demonstrations([path], dt=0.02).demonstrations) == 1


def test_roboset_is_read_by_the_joints_of_its_arm(tmp_path) -> None:
    with h5py.File(tmp_path / "roboset.h5", "w") as file:
        for trial in range(2):
            data = file.create_group(f"Trial{trial}/data")
            data["qp_arm"] = np.linspace(0, 1, 9)[:, None] ** 2 + np.arange(7.0) / 4
            data["qp_ee"] = np.zeros(9)
            data["time"] = np.arange(9.0)
    result = read_demonstrations([tmp_path / "roboset.h5"], dt=0.1)
    assert result.demonstrations.space.names == tuple(f"qp_arm_{i}" for i in range(7))
    assert [d.source for d in result.demonstrations] == ["roboset.h5, Trial0", "roboset.h5, Trial1"]


# --------------------------------------------------------------- names that other recorders use


def test_an_observation_of_another_shape_is_said_to_be_there(save_robomimic, curve) -> None:
    def edit(file: h5py.File) -> None:
        del file["data/demo_0/obs/robot0_eef_pos"]
        file["data/demo_0/obs/robot0_eef_pos"] = np.zeros((20, 1, 4))

    words = "the observation 'robot0_eef_pos' has the shape (20, 1, 4), where positions have (T, d)."
    with pytest.raises(InputDataError, match=re.escape(words)):
        read_demonstrations([save_robomimic([curve(dimension=3)], edit=edit)])


def test_a_file_with_a_user_block_is_recognised(save_robomimic, curve, tmp_path) -> None:
    motion = curve(dimension=3)
    with h5py.File(tmp_path / "block.hdf5", "w", userblock_size=1024) as file:
        file["data/demo_0/obs/robot0_eef_pos"] = motion
    with (tmp_path / "block.hdf5").open("r+b") as block:
        block.write(b"written by a recorder")
    (demonstration,) = read_demonstrations([tmp_path / "block.hdf5"], dt=0.1).demonstrations
    assert (demonstration.positions == motion).all()


def test_numbers_are_chosen_and_renamed(save_robomimic, curve) -> None:
    path = save_robomimic([curve(dimension=3)], robot1_eef_pos=lambda x: x + 1)
    columns = ["y=robot1_eef_pos_1", "x=robot1_eef_pos_0"]
    demonstrations = read_demonstrations([path], columns=columns).demonstrations
    assert demonstrations.space.names == ("y", "x")
    assert (demonstrations.demonstrations[0].positions == curve(dimension=3)[:, [1, 0]] + 1).all()
