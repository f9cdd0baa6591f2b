"""robomimic datasets: the layout, the choice of observations, the time, and files that mean harm."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from h5py import h5d, h5p, h5s, h5t

from skillctl.demonstrations.files import LIMITS
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, UsageError

OBS = "data/demo_0/obs"
POSITION = f"{OBS}/robot0_eef_pos"


@pytest.fixture
def motions(curve):
    return [curve(samples=10 + i, dimension=3, seed=i) for i in range(12)]


def test_the_first_hands_positions_are_read_in_the_order_of_the_numbers(save_robomimic, motions) -> None:
    path = save_robomimic(motions)  # HDF5 lists demo_10 before demo_2
    result = read_demonstrations([path])
    for demonstration, motion in zip(result.demonstrations, motions, strict=True):
        assert (demonstration.positions == motion).all()
        assert demonstration.times.tolist() == (np.arange(len(motion)) * (1 / 20)).tolist()
    assert [d.source for d in result.demonstrations][9:11] == [
        "low_dim.hdf5, demo_9",
        "low_dim.hdf5, demo_10",
    ]
    assert result.sources[0].importer == "robomimic"
    assert result.demonstrations.space.names == ("x", "y", "z")
    assert "left aside: robot0_eef_quat; use --columns to choose others." in result.notes[0]


def test_single_precision_compressed_chunks_and_old_files_are_read(save_robomimic, motions) -> None:
    def edit(file: h5py.File) -> None:
        del file[POSITION]
        small = motions[0].astype("<f4")
        file.create_dataset(POSITION, data=small, compression="gzip", shuffle=True, chunks=(4, 3))

    (demonstration,) = read_demonstrations([save_robomimic(motions[:1], edit=edit)]).demonstrations
    assert (demonstration.positions == motions[0].astype("<f4")).all()


def test_columns_choose_observations(save_robomimic, motions) -> None:
    path = save_robomimic(
        motions, robot0_joint_pos=lambda x: np.hstack([x, -x, x[:, :1]]), robot1_eef_pos=lambda x: x + 1
    )
    joints = read_demonstrations([path], columns=["robot0_joint_pos"], units="rad")
    assert joints.demonstrations.space.names == tuple(f"robot0_joint_pos_{i}" for i in range(7))
    assert (joints.demonstrations.demonstrations[3].positions[:, 3:6] == -motions[3]).all()
    other = read_demonstrations([path], columns=["robot1_eef_pos"])
    assert other.demonstrations.space.names == ("x", "y", "z")
    assert not any("left aside" in note for note in other.notes)
    both = read_demonstrations([path], columns=["robot1_eef_pos", "robot0_eef_pos"])
    assert both.demonstrations.space.names[2:4] == ("robot1_eef_pos_2", "robot0_eef_pos_0")
    assert (both.demonstrations.demonstrations[0].positions == np.hstack([motions[0] + 1, motions[0]])).all()
    with pytest.raises(
        InputDataError, match="no observation 'robot0_eef'; did you mean 'robot0_eef_"
    ) as error:
        read_demonstrations([path], columns=["robot0_eef"])
    assert "robot0_joint_pos" in error.value.hint
    assert "agentview_image" not in error.value.hint  # no motion
    with pytest.raises(UsageError, match="each once"):
        read_demonstrations([path], columns=["robot0_eef_pos", "robot0_eef_pos"])


def test_another_datasets_hand_is_offered(save_robomimic, motions) -> None:
    def edit(file: h5py.File) -> None:
        file.move(POSITION, f"{OBS}/ee_pos")

    with pytest.raises(InputDataError, match="no observation 'robot0_eef_pos'") as error:
        read_demonstrations([save_robomimic(motions[:1], edit=edit)])
    assert error.value.hint == (
        "Choose with --columns, as in --columns ee_pos. The observations are: ee_pos, robot0_eef_quat."
    )


@pytest.mark.parametrize(
    "env_args",
    [
        "", "{", "[" * 10**5, '{"env_kwargs": {"control_freq": 1' + "0" * 10**5 + "}}", "[20]", "20",
        {"env_kwargs": {}}, {"env_kwargs": {"control_freq": None}}, {"env_kwargs": {"control_freq": 0}},
        {"env_kwargs": {"control_freq": -20}}, {"env_kwargs": {"control_freq": True}},
        {"env_kwargs": {"control_freq": "20"}}, '{"env_kwargs": {"control_freq": NaN}}', "x" * 2**21,
    ],
    ids=range(14),
)  # fmt: skip
def test_without_a_usable_frequency_the_period_is_asked_for(save_robomimic, motions, env_args) -> None:
    path = save_robomimic(motions[:1], env_args=env_args)
    with pytest.raises(InputDataError, match="demo_0: it has no times") as error:
        read_demonstrations([path])
    assert "--dt" in error.value.hint


def test_a_given_period_counts_where_the_file_has_none(save_robomimic, motions) -> None:
    def edit(file: h5py.File) -> None:
        del file["data"].attrs["env_args"]

    (demonstration,) = read_demonstrations([save_robomimic(motions[:1], edit=edit)], dt=0.5).demonstrations
    assert demonstration.times[:3].tolist() == [0, 0.5, 1]
    result = read_demonstrations([save_robomimic(motions[:1])], dt=0.5)
    assert result.demonstrations.demonstrations[0].times[1] == 1 / 20
    assert "--dt is not used for files that contain times." in result.notes


# ------------------------------------------------------------------------------------- other layouts


def without(name: str):
    def edit(file: h5py.File) -> None:
        del file[name]

    return edit


def one_dimensional(file: h5py.File) -> None:
    del file[POSITION]
    file[POSITION] = np.zeros(10)


def text(file: h5py.File) -> None:
    del file[POSITION]
    file[POSITION] = np.full((10, 3), b"1.0")


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (without("data"), "an HDF5 file of unknown layout (found mask)."),
        (without("data/demo_0"), "an HDF5 file of unknown layout (found data, mask)."),
        (without(OBS), "its demonstrations hold no observations."),
        (
            one_dimensional,
            "the observation 'robot0_eef_pos' has the shape (10,), where positions have (T, d).",
        ),
        (text, "there is no observation 'robot0_eef_pos'"),
    ],
)
def test_other_layouts_are_refused_with_what_was_found(save_robomimic, motions, edit, words: str) -> None:
    with pytest.raises(InputDataError, match=re.escape(words)) as error:
        read_demonstrations([save_robomimic(motions[:1], edit=edit)])
    assert error.value.hint


def test_a_demonstration_that_lacks_an_observation_is_named(save_robomimic, motions) -> None:
    for name in ("data/demo_1/obs/robot0_eef_pos", "data/demo_1/obs"):
        with pytest.raises(
            InputDataError, match=r"low_dim\.hdf5: demo_1: it lacks observations that others have"
        ):
            read_demonstrations([save_robomimic(motions[:3], edit=without(name))])


def test_what_is_no_hdf5_is_refused(write) -> None:
    with pytest.raises(InputDataError, match="not an intact HDF5 file"):
        read_demonstrations([write("t,x\n0,1\n1,2\n")], input_format="robomimic")


# ------------------------------------------------------------------------------------- hostile files


def replaced_by(value: object):
    def edit(file: h5py.File) -> None:
        del file[POSITION]
        file[POSITION] = value

    return edit


def soft_group(file: h5py.File) -> None:
    file.move("data/demo_0", "data/elsewhere")
    file["data/demo_0"] = h5py.SoftLink("/data/elsewhere")


def external_group(file: h5py.File) -> None:
    del file["data"]
    file["data"] = h5py.ExternalLink("other.hdf5", "/data")


def external_storage(target: str):
    def edit(file: h5py.File) -> None:
        del file[POSITION]
        created = h5p.create(h5p.DATASET_CREATE)
        created.set_external(target.encode(), 0, 240)
        space = h5s.create_simple((10, 3))
        h5d.create(file[OBS].id, b"robot0_eef_pos", h5t.IEEE_F64LE, space, created)

    return edit


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((10, 3), "<f8")
    layout[:] = h5py.VirtualSource("other.hdf5", "data", (10, 3))
    del file[POSITION]
    file.create_virtual_dataset(POSITION, layout)


def huge(file: h5py.File) -> None:
    del file[POSITION]
    file.create_dataset(POSITION, shape=(2**38, 3), dtype="<f8", chunks=(1024, 3))


def many_just_small_enough(file: h5py.File) -> None:
    del file[POSITION]
    file.create_dataset(POSITION, shape=(2**23, 3), dtype="<f8", chunks=(2**20, 3))
    for index in range(1, 100):
        file[f"data/demo_{index}"] = file["data/demo_0"]


def countless(file: h5py.File) -> None:
    for index in range(1, 10_002):
        file[f"data/demo_{index}"] = file["data/demo_0"]


def cycle(file: h5py.File) -> None:
    del file[OBS]
    file[OBS] = file["data"]


def odd_name(file: h5py.File) -> None:
    del file["data"]
    file["\x1b[2J"] = np.zeros(3)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (replaced_by(h5py.SoftLink("/mask/train")), "/data/demo_0/obs/robot0_eef_pos: a soft, external or"),
        (replaced_by(h5py.ExternalLink("/etc/passwd", "/")), "robot0_eef_pos: a soft, external or"),
        (soft_group, "/data/demo_0: a soft, external or user-defined link, which is not followed."),
        (external_group, ": /data: a soft, external or user-defined link"),
        (external_storage("/etc/passwd"), "robot0_eef_pos: its data would come from other files."),
        (virtual, "robot0_eef_pos: its data would come from other files."),
        (huge, "obs/robot0_eef_pos (274877906944, 3): too large; at most 256 MiB of numbers"),
        (many_just_small_enough, "obs/robot0_eef_pos (8388608, 3): too large; at most 256 MiB of"),
        (countless, "/data: more than 10000 members."),
        (cycle, "there is no observation 'robot0_eef_pos'."),
        (odd_name, r"of unknown layout (found \x1b[2J, mask)."),
    ],
)  # fmt: skip
def test_what_leads_out_of_the_file_or_has_no_end_is_refused(save_robomimic, motions, edit, words) -> None:
    path = save_robomimic(motions[:1], edit=edit)
    start = time.monotonic()
    with pytest.raises(InputDataError) as error:
        read_demonstrations([path])
    assert time.monotonic() - start < 10
    assert words in str(error.value)
    assert str(error.value).isprintable()
    assert error.value.hint


def test_links_that_nobody_asked_for_are_left_alone(save_robomimic, motions) -> None:
    def edit(file: h5py.File) -> None:
        file[f"{OBS}/depth"] = h5py.ExternalLink("/etc/passwd", "/")
        file["data/elsewhere"] = h5py.SoftLink("/nowhere")

    result = read_demonstrations([save_robomimic(motions[:1], edit=edit)])
    assert "left aside: robot0_eef_quat; use --columns to choose others." in result.notes[0]


def test_no_other_file_is_opened(save_robomimic, motions, tmp_path) -> None:
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed")
    target = tmp_path / "secret-target"
    target.write_bytes(bytes(4096))
    path = save_robomimic(motions[:1], edit=external_storage(str(target)))
    code = "import sys, skillctl.demonstrations.reader as d; d.read_demonstrations([sys.argv[1]])"
    command = ["strace", "-f", "-e", "trace=open,openat,openat2", sys.executable, "-c", code, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if "low_dim.hdf5" not in run.stderr.split("Traceback")[0]:
        pytest.skip("strace may not trace here")
    assert "would come from other files" in run.stderr
    assert "secret-target" not in run.stderr


def test_a_file_that_libhdf5_never_finishes_is_given_up(save_robomimic, motions, shell) -> None:
    path = save_robomimic(motions[:1])
    content = bytearray(path.read_bytes())
    # The size of the heap that env_args lies in: with an odd one, HDF5 2.0 looks for its objects for ever.
    content[content.index(b"GCOL") + 8] ^= 0x8F
    path.write_bytes(content)
    begin = time.monotonic()
    shell("learn", path, "--input-format", "npz", "-o", "reach.h5")  # refused at once: start-up alone
    start = time.monotonic()
    run = shell("learn", path, "-o", "reach.h5")
    # Start-up takes as long again, or twice as long on a busy machine.
    assert time.monotonic() - start < LIMITS.seconds + 2 * (start - begin)
    assert "takes longer than 8 s" in run.stderr
    assert (run.returncode, run.stdout) == (5, "")
    assert str(path) in run.stderr
    assert "hint:" in run.stderr
    assert not list(path.parent.glob("reach.h5*"))


@pytest.mark.parametrize("size", [512, 1024, 4096])
def test_a_file_may_begin_with_a_block_of_its_user(save_robomimic, motions, tmp_path, size: int) -> None:
    plain = save_robomimic(motions[:1])
    path = tmp_path / "block.hdf5"
    with h5py.File(plain) as old, h5py.File(path, "w", userblock_size=size) as new:
        for name in old:
            old.copy(name, new)
    assert path.read_bytes()[:4] != b"\x89HDF"
    result = read_demonstrations([path], dt=0.1)
    assert result.sources[0].importer == "robomimic"
    assert (result.demonstrations.demonstrations[0].positions == motions[0]).all()


def test_an_observation_of_another_shape_is_refused_by_it(save_robomimic, motions) -> None:
    def edit(file: h5py.File) -> None:
        del file[POSITION]
        file[POSITION] = np.zeros((10, 1, 4))

    with pytest.raises(InputDataError, match=r"'robot0_eef_pos' has the shape \(10, 1, 4\), where") as error:
        read_demonstrations([save_robomimic(motions[:1], edit=edit)])
    assert error.value.hint.endswith("The others are: robot0_eef_quat.")
