"""Stand-ins of robots' libraries, with the names and arguments of franky 2.0, ur_rtde 1.6 and rclpy."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

CALLS: list[tuple[Any, ...]] = []  # what was called, with what, in order


def module(name: str, **members: Any) -> ModuleType:
    """Return a module with these members."""
    made = ModuleType(name)
    vars(made).update(members)
    return made


# --- franky ------------------------------------------------------------------------------------------------


class Future:
    """``franky.BoolFuture``: done at the third look."""

    def __init__(self) -> None:
        self.looks = 0

    def wait(self, timeout: float | None = None) -> bool:
        self.looks += 1
        return self.looks >= 3


class FrankaGripper:
    """``franky.Gripper``."""

    def __init__(self, fci_hostname: str) -> None:
        CALLS.append(("Gripper", fci_hostname))

    def grasp_async(
        self,
        width: float,
        speed: float,
        force: float,
        epsilon_inner: float = 0.005,
        epsilon_outer: float = 0.005,
    ) -> Future:
        CALLS.append(("grasp_async", width, speed, force, epsilon_inner, epsilon_outer))
        return Future()

    def open_async(self, speed: float) -> Future:
        CALLS.append(("open_async", speed))
        return Future()


class Robot:
    """``franky.Robot``."""

    def __init__(
        self, fci_hostname: str, relative_dynamics_factor: float = 1.0, *, realtime_config: str
    ) -> None:
        CALLS.append(("Robot", fci_hostname, realtime_config))
        self.milliseconds = 0

    def recover_from_errors(self) -> bool:
        return True

    @property
    def state(self) -> Any:
        self.milliseconds += 1
        time = SimpleNamespace(to_msec=lambda: self.milliseconds)
        pose = SimpleNamespace(translation=np.array([0.4, 0.1, 0.3]), quaternion=np.array([1.0, 0, 0, 0]))
        return SimpleNamespace(O_T_EE=pose, time=time)

    def move(self, motion: Any, asynchronous: bool = False) -> None:
        assert asynchronous
        CALLS.append(("move", *motion))

    def join_motion(self, timeout: float | None = None) -> bool:
        CALLS.append(("join_motion",))
        return True


def franky() -> ModuleType:
    """Return a stand-in of franky."""
    faults = ("CommandException", "ControlException", "NetworkException")
    return module(
        "franky",
        Robot=Robot,
        Gripper=FrankaGripper,
        RealtimeConfig=SimpleNamespace(Ignore="ignore", Enforce="enforce"),
        Twist=lambda linear_velocity=None, angular_velocity=None: (linear_velocity, angular_velocity),
        Duration=lambda milliseconds: milliseconds,
        CartesianVelocityMotion=lambda target, duration=1000: ("velocity", target, duration),
        CartesianVelocityStopMotion=lambda: ("stop",),
        **{name: type(name, (Exception,), {}) for name in faults},
    )


# --- ur_rtde -----------------------------------------------------------------------------------------------


class RTDEControlInterface:
    """``rtde_control.RTDEControlInterface``."""

    taken = True  # whether the arm takes commands

    def __init__(self, hostname: str) -> None:
        CALLS.append(("control", hostname))

    def setWatchdog(self, min_frequency: float = 10.0) -> bool:  # noqa: N802
        CALLS.append(("setWatchdog", min_frequency))
        return True

    def kickWatchdog(self) -> bool:  # noqa: N802
        CALLS.append(("kickWatchdog",))
        return True

    def speedL(self, xd: list[float], acceleration: float = 0.25, time: float = 0.0) -> bool:  # noqa: N802
        CALLS.append(("speedL", xd, acceleration, time))
        return self.taken

    def speedStop(self, a: float = 10.0) -> bool:  # noqa: N802
        CALLS.append(("speedStop", a))
        return True

    def stopScript(self) -> None:  # noqa: N802
        CALLS.append(("stopScript",))

    def disconnect(self) -> None:
        CALLS.append(("disconnect",))


class RTDEReceiveInterface:
    """``rtde_receive.RTDEReceiveInterface``."""

    def __init__(self, hostname: str) -> None:
        self.seconds = 0.0

    def getTimestamp(self) -> float:  # noqa: N802
        self.seconds += 0.002
        return self.seconds

    def getActualTCPPose(self) -> list[float]:  # noqa: N802
        return [0.4, 0.1, 0.3, 0.0, 3.1, 0.1]

    def disconnect(self) -> None:
        CALLS.append(("disconnect",))


class RTDEIOInterface:
    """``rtde_io.RTDEIOInterface``."""

    def __init__(self, hostname: str) -> None:
        pass

    def setToolDigitalOut(self, output_id: int, signal_level: bool) -> bool:  # noqa: N802
        CALLS.append(("setToolDigitalOut", output_id, signal_level))
        return True

    def disconnect(self) -> None:
        CALLS.append(("disconnect",))


# --- ROS 2 -------------------------------------------------------------------------------------------------


def message() -> Any:
    """Return a message of any type: fields that the real ones have are made as they are used."""

    class Fields(SimpleNamespace):
        def __getattr__(self, name: str) -> Any:
            setattr(self, name, Fields())
            return getattr(self, name)

    return Fields()


def pose_message(numbers: tuple[float, ...]) -> Any:
    """Return a PoseStamped in the frame ``base_link``."""
    made = message()
    made.header.frame_id = "base_link"
    p, q = made.pose.position, made.pose.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = numbers
    return made


class Node:
    """``rclpy.node.Node``."""

    def __init__(self) -> None:
        self.callbacks: dict[str, Any] = {}
        self.waiting: list[Any] = []

    def create_subscription(self, msg_type: Any, topic: str, callback: Any, qos_profile: int) -> None:
        CALLS.append(("subscribe", msg_type, topic, qos_profile))
        self.callbacks[topic] = callback

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: int) -> Any:
        CALLS.append(("publisher", msg_type, topic, qos_profile))
        return SimpleNamespace(publish=lambda sent: CALLS.append((topic, sent)))

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now"))

    def destroy_node(self) -> None:
        CALLS.append(("destroy_node",))


NODES: list[Node] = []


def create_node(node_name: str, *, namespace: str | None = None) -> Node:
    CALLS.append(("create_node", node_name, namespace))
    NODES.append(Node())
    return NODES[-1]


def spin_once(node: Node, *, executor: Any = None, timeout_sec: float | None = None) -> None:
    assert timeout_sec == 0.0
    if node.waiting:
        node.callbacks["pose"](node.waiting.pop(0))


def init(*, args: list[str] | None = None, signal_handler_options: Any = None) -> None:
    CALLS.append(("init", args, signal_handler_options))


MODULES = {
    "franky": franky(),
    "rtde_control": module("rtde_control", RTDEControlInterface=RTDEControlInterface),
    "rtde_receive": module("rtde_receive", RTDEReceiveInterface=RTDEReceiveInterface),
    "rtde_io": module("rtde_io", RTDEIOInterface=RTDEIOInterface),
    "rclpy": module(
        "rclpy",
        init=init,
        create_node=create_node,
        spin_once=spin_once,
        shutdown=lambda: CALLS.append(("shutdown",)),
    ),
    "rclpy.signals": module("rclpy.signals", SignalHandlerOptions=SimpleNamespace(NO="no")),
    "geometry_msgs": module("geometry_msgs"),
    "geometry_msgs.msg": module(
        "geometry_msgs.msg",
        PoseStamped=type("PoseStamped", (), {"__new__": lambda cls: message()}),
        TwistStamped=type("TwistStamped", (), {"__new__": lambda cls: message()}),
    ),
    "std_msgs": module("std_msgs"),
    "std_msgs.msg": module("std_msgs.msg", String=lambda data: SimpleNamespace(data=data)),
}
