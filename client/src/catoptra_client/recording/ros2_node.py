"""The messages of a recording as live topics of a ROS 2 node, and `/cmd_vel` as wheel speeds.

rclpy belongs to a sourced installation of ROS 2. PyPI has unofficial wheels, which lack tf2_msgs:
topics whose package of messages is missing are left out.

The node is on the loopback alone unless the environment says otherwise, in ROS's own variables.
"""

from __future__ import annotations

import array
import os
import re
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.recording import ros2_messages as ros
from catoptra_client.recording.recorder import MessageSink, MessageSource, RecordingProgress
from catoptra_protocol.errors import CatoptraError

HALT_AFTER_S = 0.3
"""Time after the last message of /cmd_vel at which the robot halts."""
_CMD_VEL = "/cmd_vel"


def run_node(
    source: MessageSource,
    driver: StreamClient,
    robot: str,
    duration_s: float | None = None,
    on_progress: Callable[[RecordingProgress], None] = lambda _: None,
) -> RecordingProgress:
    """Publish the messages of a source, and drive a robot by /cmd_vel, until the source ends.

    Args:
        source: Messages of the robot.
        driver: Client that drives the robot: its own, or one that is shared.
        robot: Name of the robot, which is there.
        duration_s: Seconds of the time of day; None: until the source is stopped.
        on_progress: Receives the progress twice a second.

    Raises:
        CatoptraError: No ROS 2, server, robot or camera.
    """
    state = next(one for one in driver.get_state(robot).robots if one.name == robot)
    if not state.wheel_radius_m:
        raise CatoptraError("a server of an earlier release, which does not state the wheels")

    def drive(forward_m_s: float, turn_rad_s: float) -> None:
        wheels = state.wheel_radius_m, state.wheel_separation_m
        left, right = ros.wheel_speeds(forward_m_s, turn_rad_s, *wheels)
        # By the server's clock, so that a robot halts as well when this process is gone.
        driver.drive(left, right, robot=robot, halt_after_s=HALT_AFTER_S)

    with _Node(drive) as node:
        return source.publish(node, duration_s, on_progress)


class _Node(MessageSink):
    """A node with a publisher for each topic; also a context manager."""

    is_full = False
    num_messages = 0

    def __init__(self, drive: Callable[[float, float], None]) -> None:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        # The variable of Humble, which does not know the other one.
        if os.environ.get("ROS_DISTRO") == "humble":
            os.environ.setdefault("ROS_LOCALHOST_ONLY", "1")
        try:
            import rclpy
            from geometry_msgs.msg import Twist
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.qos import DurabilityPolicy, QoSProfile
            from rclpy.signals import SignalHandlerOptions
        except ImportError as error:
            raise CatoptraError(
                f"ROS 2 is not here ({error}): source an installation, as by `source "
                "/opt/ros/humble/setup.bash`, or install the unofficial wheels of PyPI, "
                "pip install 'catoptra-client[ros2]'"
            ) from error
        self._drive = drive
        self._publishers: dict[str, Any] = {}
        self._qos = {
            True: QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            # Three seconds of pictures, for a subscriber on a busy machine.
            False: QoSProfile(depth=100),
        }
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._shut_down = rclpy.try_shutdown
        self._node = rclpy.create_node("catoptra")
        # A depth of 1: of commands that come faster than they are sent the newest counts.
        self._node.create_subscription(Twist, _CMD_VEL, self._receive, 1)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin)
        self._thread.start()

    def __enter__(self) -> _Node:
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._shut_down()

    def _receive(self, twist: Any) -> None:
        try:
            self._drive(twist.linear.x, twist.angular.z)
        except CatoptraError as error:
            self._node.get_logger().warning(f"{_CMD_VEL}: {error}", throttle_duration_sec=1.0)

    def add_message(
        self,
        topic: str,
        type_name: str,
        message: ros.RosMessage,
        *,
        log_ns: int,
        publish_ns: int,
        is_latched: bool = False,
    ) -> None:
        """Publish a message: latched ones for late subscribers too."""
        if topic not in self._publishers:
            self._publishers[topic] = self._make_publisher(topic, type_name, is_latched)
        publisher = self._publishers[topic]
        if publisher is not None:
            publisher.publish(fill_message(publisher.msg_type(), message))
            self.num_messages += 1

    def _make_publisher(self, topic: str, type_name: str, is_latched: bool) -> Any:
        """Publisher of a topic; None of one that is left out."""
        if topic == _CMD_VEL:
            return None  # an input here
        try:
            message_type = find_message_type(type_name)
        except ImportError as error:
            print(f"{topic} is left out: {error}", file=sys.stderr)
            return None
        # Names of cameras and sensors have characters that those of topics cannot have.
        name = re.sub(r"/(?=[0-9])", "/_", re.sub(r"[^A-Za-z0-9_/]", "_", topic))
        return self._node.create_publisher(message_type, name, self._qos[is_latched])


def find_message_type(type_name: str) -> Any:
    """Class of a type, `package/Name`.

    Raises:
        ImportError: Its package is not installed.
    """
    package, _, name = type_name.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


def fill_message(message: Any, values: ros.RosMessage) -> Any:
    """Set the fields of a message from a dictionary, but those that its release of ROS lacks."""
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in kinds:
            continue
        if isinstance(value, dict):
            fill_message(getattr(message, name), value)
            continue
        if isinstance(value, bytes):
            # Other sequences are checked byte by byte.
            value = array.array("B", value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            part = find_message_type(kinds[name].removeprefix("sequence<").removesuffix(">"))
            value = [fill_message(part(), one) for one in value]
        setattr(message, name, value)
    return message
