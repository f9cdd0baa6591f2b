"""Any robot with ROS 2: poses come from a topic; twists or poses go to another one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.drivers.driver import Driver, Measured, Setup, library, twist
from skillctl.model.pose import Pose

SOURCE = "ROS 2 is not on the package index; source its setup, as in . /opt/ros/jazzy/setup.bash"
NEWEST = 1  # depth of the queues: what is old is of no use
LEASH = 0.05  # [m]: a robot that does not follow is not pulled from farther away


class RosTwist(Driver):
    """``ros2-twist:NAMESPACE``: takes PoseStamped from ``pose``, gives TwistStamped to ``twist``.

    Events of chains go to ``event``, as String.
    """

    untried = "a stand-in of rclpy"
    grips = True

    def __init__(self, setup: Setup) -> None:
        """Make a node. See ``Driver``."""
        super().__init__(setup)
        setup.require_hand()
        self._rclpy = library("rclpy", SOURCE)
        self._messages, texts = library("geometry_msgs.msg", SOURCE), library("std_msgs.msg", SOURCE)
        signals = library("rclpy.signals", SOURCE)
        self._rclpy.init(args=[], signal_handler_options=signals.SignalHandlerOptions.NO)  # Ctrl-C is ours
        self._node = self._rclpy.create_node("skillctl", namespace=setup.address or None)
        self._node.create_subscription(self._messages.PoseStamped, "pose", self._take, NEWEST)
        self._publisher = self._node.create_publisher(*self._target())
        self._text, self._events = texts.String, self._node.create_publisher(texts.String, "event", 10)
        self._frame = ""
        self._newest: Measured | None = None

    def _target(self) -> tuple[Any, str, int]:
        return self._messages.TwistStamped, "twist", NEWEST

    def _take(self, message: Any) -> None:
        p, q = message.pose.position, message.pose.orientation
        self._frame = message.header.frame_id  # commands are in the same frame
        count = 0.0 if self._newest is None else self._newest.stamp + 1
        self._newest = Measured(count, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))

    def state(self) -> Measured | None:
        """Return the newest pose."""
        self._rclpy.spin_once(self._node, timeout_sec=0.0)
        return self._newest

    def command(self, velocity: Sequence[float]) -> None:
        """Publish a twist, in the frame of the poses."""
        message = self._stamped(self._messages.TwistStamped())
        linear, angular = message.twist.linear, message.twist.angular
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = map(float, twist(velocity))
        self._publisher.publish(message)

    def _stamped(self, message: Any) -> Any:
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        return message

    def event(self, text: str) -> bool:
        """Publish what is due; how long it takes, a ``wait`` in the chain has to say."""
        self._events.publish(self._text(data=text))
        return False

    def close(self) -> None:
        """End the node."""
        self._node.destroy_node()
        self._rclpy.shutdown()


class RosPose(RosTwist):
    """``ros2-pose:NAMESPACE``: takes PoseStamped from ``pose``, gives PoseStamped to ``target``.

    The target starts where the hand is, and moves with the commanded velocity, at most ``LEASH`` ahead of it.
    """

    _reference: FloatArray | None = None

    def _target(self) -> tuple[Any, str, int]:
        return self._messages.PoseStamped, "target", NEWEST

    def command(self, velocity: Sequence[float]) -> None:
        """Publish where the hand should be one period from now."""
        if self._newest is None:
            return
        space = Pose()
        measured = space.measured(self._newest.numbers)
        reference = measured if self._reference is None else self._reference
        reference = space.displace_at(reference, self.period * np.array(twist(velocity)))
        ahead = reference[:3] - measured[:3]
        reference[:3] = measured[:3] + ahead * min(1.0, LEASH / max(float(np.linalg.norm(ahead)), LEASH))
        self._reference = reference
        message = self._stamped(self._messages.PoseStamped())
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = space.given(reference)
        self._publisher.publish(message)
