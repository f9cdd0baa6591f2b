"""Bags: written by the writers of rosbags in the formats that robots record, and read back."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from skillctl.arrays import FloatArray
from skillctl.demonstrations import bags
from skillctl.demonstrations.files import File
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, NotFoundError, UsageError

EPOCH = 1_700_000_000 * 10**9  # [ns], where float64 has steps of 256 ns
PERIOD = 10_000_000  # [ns]
LATE = 3_000_000  # [ns] from a stamp to its recording
KINDS = ["ros1", "ros1-lz4", "sqlite3", "sqlite3-messages", "mcap", "mcap-zstd"]
POSE = "geometry_msgs/msg/PoseStamped"
JOINTS = "sensor_msgs/msg/JointState"


class Messages:
    """Messages of one generation of ROS."""

    def __init__(self, store: Stores) -> None:
        self.store = get_typestore(store)
        if store is Stores.ROS1_NOETIC:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self.seq = {"seq": 0} if store is Stores.ROS1_NOETIC else {}

    def __getattr__(self, name: str) -> Any:
        package = {"Header": "std_msgs", "Time": "builtin_interfaces", "JointState": "sensor_msgs"}
        package |= {"TFMessage": "tf2_msgs", "Odometry": "nav_msgs", "String": "std_msgs"}
        return self.store.types[f"{package.get(name, 'geometry_msgs')}/msg/{name}"]

    def header(self, stamp: int, frame: str = "panda_link0") -> Any:
        time = self.Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.Header(**self.seq, stamp=time, frame_id=frame)

    def pose(
        self,
        stamp: int,
        position: FloatArray,
        frame: str = "panda_link0",
        turn: Sequence[float] = (0, 0, 0, 1),
    ) -> Any:
        turn = self.Quaternion(*map(float, turn))
        pose = self.Pose(position=self.Point(*position.tolist()), orientation=turn)
        return self.PoseStamped(header=self.header(stamp, frame), pose=pose)

    def transform(
        self,
        stamp: int,
        position: FloatArray,
        child: str,
        frame: str = "panda_link0",
        turn: Sequence[float] = (0, 0, 0, 1),
    ) -> Any:
        turn = self.Quaternion(*map(float, turn))
        transform = self.Transform(translation=self.Vector3(*position.tolist()), rotation=turn)
        return self.TransformStamped(
            header=self.header(stamp, frame), child_frame_id=child, transform=transform
        )

    def joints(self, stamp: int, **angles: float) -> Any:
        numbers = np.array(list(angles.values()))
        header = self.header(stamp)
        return self.JointState(
            header=header, name=list(angles), position=numbers, velocity=0 * numbers, effort=0 * numbers
        )

    def odometry(self, stamp: int, position: FloatArray) -> Any:
        pose = self.PoseWithCovariance(pose=self.pose(stamp, position).pose, covariance=np.zeros(36))
        still = self.Twist(linear=self.Vector3(0.0, 0.0, 0.0), angular=self.Vector3(0.0, 0.0, 0.0))
        twist = self.TwistWithCovariance(twist=still, covariance=np.zeros(36))
        return self.Odometry(header=self.header(stamp, "odom"), child_frame_id="base", pose=pose, twist=twist)

    def point(self, stamp: int, position: FloatArray) -> Any:
        return self.PointStamped(header=self.header(stamp), point=self.Point(*position.tolist()))


@pytest.fixture
def save(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag of (topic, time of recording, message), which ``made`` returns."""

    def save(made: Callable[[Messages], list[tuple[str, int, Any]]], kind: str = "mcap") -> Path:
        form, _, packed = kind.partition("-")
        messages = Messages(Stores.ROS1_NOETIC if form == "ros1" else Stores.ROS2_HUMBLE)
        path = tmp_path / (f"{kind}.bag" if form == "ros1" else kind)
        if form == "ros1":
            writer: Any = Writer1(path)
            if packed:
                writer.set_compression(Writer1.CompressionFormat.LZ4)
        else:
            plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[form]
            writer = Writer2(path, version=9, storage_plugin=plugin)
            if packed:
                modes = {"messages": CompressionMode.MESSAGE, "file": CompressionMode.FILE}
                mode = modes.get(packed, CompressionMode.STORAGE)
                writer.set_compression(mode, CompressionFormat.ZSTD)
        serialize = messages.store.serialize_ros1 if form == "ros1" else messages.store.serialize_cdr
        connections: dict[str, Any] = {}
        with writer:
            for topic, time, message in made(messages):
                kind_of = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind_of, typestore=messages.store)
                writer.write(connections[topic], time, serialize(message, kind_of))
        return path

    return save


def poses(motion: FloatArray, topic: str = "/pose", **options: Any) -> Callable[[Messages], Any]:
    return lambda messages: [
        (topic, stamp + LATE, messages.pose(stamp, position, **options))
        for stamp, position in zip(stamps(motion), motion, strict=True)
    ]


def stamps(motion: FloatArray) -> list[int]:
    return [EPOCH + PERIOD * i for i in range(len(motion))]


@pytest.mark.parametrize("kind", ["PoseStamped", "TFMessage"])
def test_orientations_of_poses_and_transforms_are_read(save, curve, kind: str) -> None:
    motion = curve(dimension=3)
    angles = np.linspace(0, 1, len(motion))  # about z: the quaternion is (0, 0, sin(angle/2), cos(angle/2))
    turns = [(0, 0, np.sin(angle / 2), np.cos(angle / 2)) for angle in angles]

    def made(messages: Messages) -> list[tuple[str, int, Any]]:
        each = list(zip(stamps(motion), motion, turns, strict=True))
        if kind == "PoseStamped":
            return [("/pose", stamp, messages.pose(stamp, x, turn=turn)) for stamp, x, turn in each]
        transforms = [messages.transform(stamp, x, "tool0", turn=turn) for stamp, x, turn in each]
        return [
            ("/tf", stamp, messages.TFMessage([transform]))
            for stamp, transform in zip(stamps(motion), transforms, strict=True)
        ]

    path = save(made, "mcap")
    result = read_demonstrations([path])
    (demonstration,) = result.demonstrations
    expected = np.column_stack([motion, 0 * angles, 0 * angles, angles])
    assert np.abs(demonstration.positions - expected).max() <= 1e-15  # [rad], of float64
    assert result.notes[1].startswith("the orientation is qx, qy, qz, qw: a quaternion x, y, z, w; ")
    assert read_demonstrations([path], position_only=True).demonstrations.dimension == 3


@pytest.mark.parametrize("kind", KINDS)
def test_poses_are_read_by_their_stamps(save, curve, kind: str) -> None:
    motion = curve(dimension=3)
    result = read_demonstrations([save(poses(motion), kind)])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == motion).all()
    assert demonstration.times.tolist() == [i * PERIOD / 1e9 for i in range(len(motion))]
    assert result.demonstrations.space.names == ("x", "y", "z")
    assert result.sources[0].importer == "bag"
    assert result.notes[0].endswith("positions are in the frame 'panda_link0'.")


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_the_one_file_of_a_bag_is_enough_whatever_its_name(save, curve, kind: str) -> None:
    folder = save(poses(curve(dimension=3)), kind)
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    (demonstration,) = read_demonstrations([file.rename(folder.parent / "recording")]).demonstrations
    assert (demonstration.positions == curve(dimension=3)).all()


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_points_transforms_and_odometry_are_positions(save, curve, kind: str) -> None:
    motion = curve(dimension=3)

    def made(messages: Messages) -> list[tuple[str, int, Any]]:
        entries = []
        for stamp, position in zip(stamps(motion), motion, strict=True):
            transform = messages.transform(stamp, position + 3, "tool0")
            elbow = messages.transform(stamp, position + 4, "elbow")
            entries += [
                ("/point", stamp, messages.point(stamp, position + 1)),
                ("/odom", stamp, messages.odometry(stamp, position + 2)),
                ("/marker", stamp, messages.transform(stamp, position + 5, "marker")),
                ("/tf", stamp, messages.TFMessage(transforms=[elbow, transform])),
            ]
        return entries

    path = save(made, kind)
    for topic, offset in {"/point": 1, "/odom": 2, "/tf:tool0": 3, "/tf:elbow": 4, "/marker": 5}.items():
        result = read_demonstrations([path], topic=topic)
        assert (result.demonstrations.demonstrations[0].positions == motion + offset).all()
        assert result.notes[0].endswith("frame 'odom'." if topic == "/odom" else "frame 'panda_link0'.")
    with pytest.raises(InputDataError, match="5 topics could be the motion; which is") as error:
        read_demonstrations([path])
    assert "--topic" in error.value.hint
    for words in ("/tf:tool0 (TFMessage, 20)", "/odom (Odometry, 20)", "/point (PointStamped, 20)"):
        assert words in error.value.hint
    with pytest.raises(InputDataError, match="no topic /tf:tool1 with a motion") as error:
        read_demonstrations([path], topic="/tf:tool1")
    assert "Did you mean /tf:tool0?" in error.value.hint


def test_joints_are_taken_by_name_whoever_publishes_them(save) -> None:
    def made(messages: Messages) -> list[tuple[str, int, Any]]:
        entries = []
        for i in range(20):
            stamp, a = EPOCH + i * PERIOD, (i / 20) ** 2
            fingers = messages.joints(stamp + 1, finger_joint1=0.04, finger_joint2=0.04)
            arm = (
                {"j2": 2 + a, "j1": 1 + a, "j3": 3 + a} if i % 2 else {"j1": 1 + a, "j2": 2 + a, "j3": 3 + a}
            )
            entries += [
                ("/joint_states", stamp, messages.joints(stamp, **arm)),
                ("/joint_states", stamp, fingers),
            ]
        return entries

    path = save(made)
    result = read_demonstrations([path])
    (demonstration,) = result.demonstrations
    expected = (np.arange(20)[:, None] / 20) ** 2 + [1, 2, 3]
    assert (demonstration.positions == expected).all()
    assert result.demonstrations.space.names == ("j1", "j2", "j3")
    assert result.demonstrations.space.unit == "rad"
    assert result.notes[0].startswith("the position is j1, j2, j3; left aside: finger_joint1, finger_joint2;")
    chosen = read_demonstrations([path], columns=["j3", "j1"])
    assert (chosen.demonstrations.demonstrations[0].positions == expected[:, [2, 0]]).all()


def test_without_stamps_the_times_of_recording_count(save, curve) -> None:
    motion = curve(dimension=3)
    path = save(lambda m: [("/p", EPOCH + PERIOD * i, m.pose(0, x)) for i, x in enumerate(motion)])
    result = read_demonstrations([path])
    assert result.demonstrations.demonstrations[0].times[1] == PERIOD / 1e9
    assert any("header stamps are not set" in note for note in result.notes)


def test_messages_that_arrive_late_are_put_in_order(save, curve) -> None:
    motion = curve(dimension=3)

    def late(messages: Messages) -> list[tuple[str, int, Any]]:
        entries = [messages.pose(s, x) for s, x in zip(stamps(motion), motion, strict=True)]
        entries[4], entries[5] = entries[5], entries[4]
        return [("/p", EPOCH + i, entry) for i, entry in enumerate(entries)]

    (demonstration,) = read_demonstrations([save(late)]).demonstrations
    assert (demonstration.positions == motion).all()


def test_positions_in_several_frames_are_refused(save, curve) -> None:
    motion = curve(dimension=3)
    path = save(lambda m: poses(motion)(m) + poses(motion, frame="map")(m), "mcap-zstd")
    with pytest.raises(InputDataError, match="in several frames: panda_link0, map"):
        read_demonstrations([path])
    one, other = save(poses(motion), "mcap"), save(poses(motion, frame="map"), "sqlite3")
    with pytest.raises(InputDataError, match=r"in the frame map, but .* is in panda_link0"):
        read_demonstrations([one, other])


def test_a_bag_without_a_motion_says_what_it_holds(save, curve, write) -> None:
    path = save(lambda m: [("/talk", EPOCH + i, m.String(data="hello")) for i in range(3)])
    with pytest.raises(
        InputDataError, match=r"no topic holds a motion \(found /talk \(String, 3\)\)"
    ) as error:
        read_demonstrations([path])
    assert "PoseStamped" in error.value.hint
    with pytest.raises(UsageError, match="only bags have topics"):
        read_demonstrations([write("t,x,y\n0,1,2\n1,2,3\n")], topic="/pose")


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_are_refused_in_words(save, curve, child, kind: str) -> None:
    path = save(poses(curve(dimension=3)), kind)
    file = path if path.is_file() else next(p for p in path.iterdir() if p.name != "metadata.yaml")
    intact = file.read_bytes()
    random = np.random.default_rng(0)
    for end in (100, len(intact) // 2):
        file.write_bytes(intact[:end])
        with pytest.raises(InputDataError) as error:
            bags.read(File(path, b"", None, child))
        assert str(error.value).startswith(str(path))
    for _ in range(20):
        damaged = bytearray(intact)
        for _ in range(8):
            damaged[random.integers(16, len(damaged))] = random.integers(256)
        file.write_bytes(damaged)
        try:
            bags.read(File(path, b"", None, child))
        except InputDataError as refusal:
            assert str(refusal).isprintable()  # noqa: PT017  # either is right


def test_a_bag_that_is_packed_as_a_whole_says_how_to_unpack_it(save, curve) -> None:
    with pytest.raises(InputDataError, match="its files are compressed as a whole") as error:
        read_demonstrations([save(poses(curve(dimension=3)), "sqlite3-file")])
    assert "zstd -d" in error.value.hint


def test_a_folder_with_bags_says_to_name_them(save, curve) -> None:
    path = save(poses(curve(dimension=3)))
    (path / "metadata.yaml").unlink()
    with pytest.raises(InputDataError, match="is a folder, not a file") as error:
        read_demonstrations([path])
    assert error.value.hint == f"Name its files: {path}/*.mcap"


def test_metadata_lead_nowhere_else(save, curve, tmp_path) -> None:
    path = save(poses(curve(dimension=3)), "sqlite3")
    (file,) = path.glob("*.db3")
    file.rename(tmp_path / "elsewhere.db3")
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(file.name, "../elsewhere.db3"))
    with pytest.raises(InputDataError, match="not an intact bag"):
        read_demonstrations([path])


def test_without_its_reader_a_bag_says_what_to_install(save, curve, monkeypatch) -> None:
    monkeypatch.setattr("skillctl.demonstrations.formats.find_spec", lambda name: None)
    with pytest.raises(NotFoundError, match="rosbags is not installed") as error:
        read_demonstrations([save(poses(curve(dimension=3)))])
    assert error.value.hint == "pip install rosbags"


def test_the_library_is_imported_by_the_child_only(save, curve) -> None:
    code = (
        "import sys; from skillctl.demonstrations.reader import read_demonstrations as read; "
        "read([sys.argv[1]]); print('rosbags' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(save(poses(curve(dimension=3))))]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "False\n"
