"""Bags of ROS 1 and 2, and MCAP: one motion, as positions or joints on one topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from skillctl.demonstrations.features import choose
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import Recording, listed
from skillctl.errors import InputDataError, did_you_mean, printable
from skillctl.model.space import AXIS_NAMES
from skillctl.opening import open_regular

KIND = "bag"
STARTS = {b"#ROSBAG V": "ROS 1", b"\x89MCAP": ".mcap", b"SQLite format 3\0": ".db3"}
POSITIONS = {  # messages with a header, and where their position is, and their orientation
    "geometry_msgs/msg/PointStamped": ("point", ""),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.position", "pose.pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
    "nav_msgs/msg/Odometry": ("pose.pose.position", "pose.pose.orientation"),
}
QUATERNION = "xyzw"  # its numbers
JOINTS = "sensor_msgs/msg/JointState"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FORMER = {"tf/msg/tfMessage": TRANSFORMS}  # older names of the same messages
READ = (*POSITIONS, JOINTS, TRANSFORMS)
FRAME = ":"  # between a topic with transforms and the frame that moves; no topic has it in its name


def recognises(file: File) -> bool:
    """Return whether the content is a bag."""
    return file.content.startswith(tuple(STARTS))


def read(file: File) -> list[Recording]:
    """Return the one demonstration in a bag: positions in metres, or joints in radians, by header stamps.

    ``file.topic`` names the topic; without it there must be only one that can be a motion. Transforms are
    read as they are, from their parent to the frame that the topic goes on with, as in ``/tf:tool0``.
    ``file.columns`` names joints, or some of x, y, z.

    Raises:
        InputDataError: The bag is damaged, several topics or none could be the motion, or joints come and go.
    """
    path = file.path
    topic = _chosen(file.opened(topics, KIND), file)
    found = file.opened(samples, KIND, topic=topic)
    frames, what = found["frames"], "joints" if found["joints"] else "position"
    features = {what: tuple(found["names"])}
    choice = choose(list(file.columns or [what]), features, file, what="vector")
    positions, orientation = choice.split(found["rows"], features)
    there = np.flatnonzero(
        ~np.isnan(positions).all(axis=1)
    )  # several nodes may publish joints of their own on one topic
    if len(frames) > 1:
        raise InputDataError(
            f"{path}, topic {printable(topic)}: its positions are in several frames: {listed(frames)}.",
            hint="Record them in one.",
        )
    notes = [f"positions are in the frame '{printable(frame)[:40]}'." for frame in frames]
    if not found["stamped"]:
        notes.append(f"{path}: its header stamps are not set; times are those of the recording.")
    return [
        Recording(
            path,
            positions[there],
            times=found["times"][there],
            names=choice.names,
            part=f"topic {printable(topic)[:80]}",
            unit="rad" if found["joints"] else "m",
            unit_said=True,
            taken=choice.taken,
            unused=() if file.columns is not None else choice.left,
            orientation=None if orientation is None else orientation.at(there),
            frame="".join(frames),
            notes=tuple(notes),
        )
    ]


def _chosen(found: dict[str, dict[str, Any]], file: File) -> str:
    """Return the topic to be read."""
    motions = [name for name, each in found.items() if each["read"] and each["count"] > 1]
    kinds = {
        name: f"{name} ({found[name]['type'].rpartition('/')[2]}, {found[name]['count']})" for name in found
    }
    if file.topic is not None:
        if file.topic in motions:
            return file.topic
        raise InputDataError(
            f"{file.path}: there is no topic {printable(file.topic)} with a motion.",
            hint=f"{did_you_mean(file.topic, motions)} Topics with one are: "
            f"{listed([kinds[name] for name in motions], 40) or 'none'}.".lstrip(),
        )
    if not motions:
        raise InputDataError(
            f"{file.path}: no topic holds a motion (found {listed(list(kinds.values())) or 'none'}).",
            hint=f"Read are {', '.join(kind.rpartition('/')[2] for kind in READ)}.",
        )
    if len(motions) > 1:
        raise InputDataError(
            f"{file.path}: {len(motions)} topics could be the motion; which is?",
            hint=f"Choose with --topic {printable(motions[0])}. They are: "
            f"{listed([kinds[name] for name in motions], 40)}.",
        )
    return motions[0]


# ----------------------------------------------------------------------------------------- in the child


def topics(path: str) -> dict[str, Any]:
    """Return the topics of a bag: type, number of messages, and whether it can be read.

    Transforms are listed by the frame that moves.
    """
    with _opened(path) as bag:
        listing: dict[str, Any] = {}
        for each in bag.connections:
            kind = FORMER.get(each.msgtype, each.msgtype)
            if kind != TRANSFORMS:
                entry = listing.setdefault(each.topic, {"type": kind, "count": 0, "read": kind in READ})
                entry["count"] += each.msgcount
        moving = [each for each in bag.connections if FORMER.get(each.msgtype, each.msgtype) == TRANSFORMS]
        frames = Counter(
            each.topic + FRAME + transform.child_frame_id
            for each, _, message in bag.messages(moving)
            for transform in message.transforms
        )
        of_frames = {name: {"type": TRANSFORMS, "count": n, "read": True} for name, n in frames.items()}
        return {**listing, **of_frames}


def samples(path: str, topic: str) -> dict[str, Any]:
    """Return what a topic holds, in the order of its stamps.

    Returns:
        times: From the first sample on, (T,), [s].
        stamped: Whether they are the stamps of the headers, not the times of recording.
        rows: (T, d), [m] or [rad]; NaN for a joint that a message does not hold.
        names: Of the columns.
        joints: Whether they are joints.
        frames: In which the positions are.
    """
    name, _, frame = topic.partition(FRAME)
    stamps, received, values, frames = [], [], [], []
    names: dict[str, None] = {}
    with _opened(path) as bag:
        chosen = [each for each in bag.connections if each.topic == name]
        for each, time, message in bag.messages(chosen):
            for header, value in _values(message, FORMER.get(each.msgtype, each.msgtype), frame):
                stamps.append(header.stamp.sec * 10**9 + header.stamp.nanosec)
                received.append(time)
                frames.append(header.frame_id)
                values.append(value)
                names.update(dict.fromkeys(value))
    stamped = any(stamps)
    clock = np.array(stamps if stamped else received, dtype=np.int64)
    order = np.argsort(clock, kind="stable")
    rows = np.array([[values[i].get(name, np.nan) for name in names] for i in order.tolist()])
    joints = any(each.msgtype == JOINTS for each in chosen)
    return {
        "times": (clock[order] - clock[order[0]]) / 1e9,
        "stamped": stamped,
        "rows": rows,
        "names": list(names),
        "joints": joints,
        "frames": list(dict.fromkeys(frames)) if not joints else [],
    }


def _values(message: Any, kind: str, frame: str) -> Iterator[tuple[Any, dict[str, float]]]:
    """Yield the headers and numbers by name in a message."""
    if kind == JOINTS:
        yield message.header, dict(zip(message.name, map(float, message.position), strict=False))
        return
    if kind == TRANSFORMS:
        messages = [each for each in message.transforms if each.child_frame_id == frame]
        steps = POSITIONS["geometry_msgs/msg/TransformStamped"]
    else:
        messages, steps = [message], POSITIONS[kind]
    position, orientation = map(attrgetter, steps) if steps[1] else (attrgetter(steps[0]), None)
    for each in messages:
        values = {axis: float(getattr(position(each), axis)) for axis in AXIS_NAMES}
        if orientation is not None:
            turn = orientation(each)
            values |= {f"q{axis}": float(getattr(turn, axis)) for axis in QUATERNION}
        yield each.header, values


class _Bag:
    """An open bag: its connections, and their messages."""

    def __init__(self, reader: Any, deserialize: Any) -> None:
        self.connections = [each for each in reader.connections if each.msgcount]
        self._reader, self._deserialize = reader, deserialize

    def messages(self, connections: list[Any]) -> Iterator[tuple[Any, int, Any]]:
        """Yield (connection, time of recording [ns], message)."""
        if connections:  # for none of them, a reader yields all
            for each, time, raw in self._reader.messages(connections):
                kind = FORMER.get(each.msgtype, each.msgtype)
                yield each, time, self._deserialize(raw, kind)


@contextmanager
def _opened(path: str) -> Iterator[_Bag]:
    """Yield a bag while it is open. The messages that are read are known, whatever types it declares."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    place = Path(path)
    if any(place.glob("*.zstd")):  # to unpack them is to write files, which this process may not
        raise InputDataError("its files are compressed as a whole.", hint="Unpack them: zstd -d *.zstd")
    first = "" if place.is_dir() else _start(place)
    store = get_typestore(Stores.ROS1_NOETIC if first == "ROS 1" else Stores.ROS2_HUMBLE)
    if first == "ROS 1":
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
        reader: Any = Reader1(place)
    else:
        reader = Reader2.STORAGE_PLUGINS[first](place) if first else Reader2(place)
    reader.open()
    try:
        yield _Bag(reader, store.deserialize_ros1 if first == "ROS 1" else store.deserialize_cdr)
    finally:
        reader.close()


def _start(path: Path) -> str:
    with open_regular(path) as file:
        content = file.read(max(map(len, STARTS)))
    return next((kind for start, kind in STARTS.items() if content.startswith(start)), "")
