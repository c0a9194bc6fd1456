"""The live node, and recordings, as ROS 2 itself finds them; `make ros2` installs its wheels.

The subscriber is a node of this process; the publisher is `catoptra-client ros2` as a process.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from catoptra_client.__main__ import main
from catoptra_client.recording.recorder import Recorder, RecordingPlan
from catoptra_client.recording.ros2_messages import nanoseconds_from_s, wheel_speeds
from catoptra_client.recording.ros2_node import HALT_AFTER_S, find_message_type
from helpers.configs import ROBOTS
from helpers.server_process import DEADLINE_S, RunningServer, start_server

SECONDS = float(os.environ.get("CATOPTRA_ROS2_SECONDS", "6"))
CAMERA = "OmniCamPillar_Link4"
# Of packages that ROS loads.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def test_turn_to_the_left_has_faster_wheels_on_the_right() -> None:
    left, right = wheel_speeds(0.26, 1.0, wheel_radius_m=0.13, wheel_separation_m=0.5)
    assert (left, right) == pytest.approx((2.0 - 0.25 / 0.13, 2.0 + 0.25 / 0.13))


def test_command_without_ros_names_both_ways_to_have_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    with start_server(tmp_path) as server:
        assert main([*make_command(server)[:3], "--robot", "Nobody"]) == 1
        assert "--spawn adds one" in capsys.readouterr().err
        assert main(make_command(server)) == 1
    error = capsys.readouterr().err
    assert "source /opt/ros/" in error
    assert "pip install 'catoptra-client[ros2]'" in error
    # Other machines see nothing unless the user asks for it.
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_node_publishes_every_frame_and_drives_until_its_commands_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 100))
    with open_listener() as listener, start_server(tmp_path) as server:
        command = [sys.executable, "-m", "catoptra_client", *make_command(server)]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as node:
            try:
                end_s = listener.wait(lambda: len(listener.images) > 5) + SECONDS
                replies = [listener.drive_once()]
                while time.monotonic() < end_s:
                    replies.append(listener.drive_once())
            finally:
                node.send_signal(signal.SIGINT)
            summary, log = node.communicate(timeout=DEADLINE_S)
        assert node.returncode == 0, log
        assert " 0 dropped" in summary
    starts, stops = zip(*replies, strict=True)
    print(f"/cmd_vel to wheels: {1e3 * statistics.median(starts):.0f} ms", end=", ")
    print(f"stop after {statistics.median(stops):.3f} s, {len(listener.images)} images")
    assert statistics.median(starts) <= 0.06
    assert statistics.median(stops) == pytest.approx(HALT_AFTER_S, abs=0.06)
    # Each frame that the stream delivered, each once.
    first, last = listener.frames[0], listener.frames[-1]
    assert last["missed_frames"] == last["dropped_frames"] == 0
    heard = [one["sequence"] for one in listener.frames]
    expected = range(first["sequence"], last["sequence"] + 1)
    assert heard == [*expected], set(expected) - set(heard)
    # Topics come one after the other: the first and the last frames may be incomplete.
    stamps_ns = [nanoseconds_from_s(one["time_s"]) for one in listener.frames]
    assert [one for one in listener.images if stamps_ns[0] <= one <= stamps_ns[-1]] == stamps_ns
    try:
        find_message_type("tf2_msgs/TFMessage")
    except ImportError:
        assert log.count("/tf is left out: No module named 'tf2_msgs'") == 1


def test_recording_is_read_by_the_deserialiser_of_ros(tmp_path: Path) -> None:
    serialization = pytest.importorskip("rclpy.serialization", reason="needs ROS 2: make ros2")
    path = tmp_path / "drive.mcap"
    with (
        start_server(tmp_path, robot=ROBOTS / "p2at_omni_full.ini") as server,
        server.connect_stream() as client,
    ):
        client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0), name="R")
        client.drive(1.0, 2.0)
        plan = RecordingPlan(robot="R", channels=("range", "ids"))
        Recorder(path, plan, stream_port=server.stream_port).record(1.0)
    kinds, missing = set(), set()
    with path.open("rb") as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, _, message, expected in decoded.iter_decoded_messages():
            try:
                message_type = find_message_type(schema.name.replace("/msg/", "/"))
            except ImportError:
                missing.add(schema.name)
                continue
            read = serialization.deserialize_message(message.data, message_type)
            assert_same_fields(read, expected)
            kinds.add(schema.name.rpartition("/")[2])
    assert kinds >= {"Image", "CompressedImage", "CameraInfo", "LaserScan", "Range", "Imu"}
    assert kinds >= {"Odometry", "MarkerArray", "Clock", "String"}
    assert missing <= {"tf2_msgs/msg/TFMessage"}


def assert_same_fields(read: Any, expected: Any) -> None:
    """Compare a message of ROS with that of another decoder, field by field."""
    for name in read.get_fields_and_field_types():
        one, other = getattr(read, name), getattr(expected, name)
        if hasattr(one, "get_fields_and_field_types"):
            assert_same_fields(one, other)
        elif isinstance(one, list) and one and hasattr(one[0], "get_fields_and_field_types"):
            for part, other_part in zip(one, other, strict=True):
                assert_same_fields(part, other_part)
        elif isinstance(one, str):
            assert one == other, name
        else:
            other = np.frombuffer(other, np.uint8) if isinstance(other, bytes) else other
            np.testing.assert_array_equal(np.asarray(one), np.asarray(other), name)


def make_command(server: RunningServer) -> list[str]:
    """Arguments of the node that has a robot of its own."""
    return ["ros2", "--stream-port", str(server.stream_port), "--spawn", "USARBot.OmniP2AT"]


class Listener:
    """A node that hears pictures and wheels, and drives."""

    def __init__(self, node: Any, executor: Any) -> None:
        self._executor = executor
        executor.add_node(node)
        self.images: list[int] = []
        self.frames: list[dict[str, Any]] = []
        self._wheels = (0.0, 0.0)
        for topic, type_name, hear in (
            (f"/{CAMERA}/image/compressed", "sensor_msgs/CompressedImage", self._hear_image),
            ("/catoptra/frame", "std_msgs/String", self._hear_frame),
            ("/catoptra/wheel_speeds", "std_msgs/String", self._hear_wheels),
        ):
            node.create_subscription(find_message_type(type_name), topic, hear, 1000)
        self._twist = find_message_type("geometry_msgs/Twist")
        self._commands = node.create_publisher(self._twist, "/cmd_vel", 1)

    def wait(self, is_done: Callable[[], bool]) -> float:
        """Hear until something is done; when that was."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not is_done():
            assert time.monotonic() < deadline_s, "nothing more is heard"
            self._executor.spin_once(timeout_sec=0.01)
        return time.monotonic()

    def drive_once(self) -> tuple[float, float]:
        """Send one command; seconds until the wheels turn, and until they halt."""
        twist = self._twist()
        twist.linear.x, twist.angular.z = 0.2, 0.5
        sent_s = time.monotonic()
        self._commands.publish(twist)
        turning_s = self.wait(lambda: self._wheels[1] > 1.0)
        return turning_s - sent_s, self.wait(lambda: self._wheels == (0.0, 0.0)) - sent_s

    def _hear_image(self, message: Any) -> None:
        stamp = message.header.stamp
        self.images.append(10**9 * stamp.sec + stamp.nanosec)

    def _hear_frame(self, message: Any) -> None:
        self.frames.append(json.loads(message.data))

    def _hear_wheels(self, message: Any) -> None:
        left, right = json.loads(message.data)["wheel_speeds_rad_s"]
        self._wheels = left, right


@contextmanager
def open_listener() -> Iterator[Listener]:
    """A listener for the length of a block."""
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2: make ros2 installs its wheels")
    pytest.importorskip("rclpy.executors")
    rclpy.init()
    node = rclpy.create_node("listener")
    try:
        yield Listener(node, rclpy.executors.SingleThreadedExecutor())
    finally:
        node.destroy_node()
        rclpy.shutdown()
