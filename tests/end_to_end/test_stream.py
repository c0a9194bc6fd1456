"""The ZeroMQ stream of a server process, through the client library."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError, ConnectionLostError
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S, RunningServer, start_server

CLASS = "USARBot.OmniP2AT"
HOST = "127.0.0.1"
# 6 s of silence (SPEC.md 9.6), and as much for a busy machine; calls have a minute otherwise.
MAX_LOSS_S = 12.0


def connect_client(server: RunningServer) -> StreamClient:
    """Connect to the stream."""
    return StreamClient.connect(HOST, server.stream_port, DEADLINE_S)


def wait_for_robot(client: StreamClient) -> None:
    """Receive frames until one shows a robot."""
    deadline = Deadline("frame with a robot", DEADLINE_S)
    for frame in client.iter_frames():
        if frame.robot_name:
            return
        deadline.check()


def test_frames_when_of_both_transports_show_the_same(tmp_path: Path) -> None:
    with (
        start_server(tmp_path, "--clock", "lockstep", "--image-type", "GOOD") as server,
        connect_client(server) as client,
        open_frame_source(f"tcp://{HOST}:{server.image_port}", DEADLINE_S) as tcp,
        open_frame_source(f"zmq://{HOST}:{server.stream_port}", DEADLINE_S) as zmq,
    ):
        client.spawn(CLASS, start_pose="Centre")
        one, other = tcp.get_frame(), zmq.get_frame()
        assert np.array_equal(one.rgb, other.rgb)
        assert one.camera is None
        assert other.camera == client.get_camera()
        assert other.camera_name
        assert other.robot_name == CLASS.partition(".")[2]


def test_frame_of_the_stream_suffices_to_unproject_a_pixel(tmp_path: Path) -> None:
    with start_server(tmp_path, "--clock", "lockstep") as server, connect_client(server) as client:
        client.spawn(CLASS, location_m=(0.0, 0.0, 0.0), rotation_rad=(0.0, 0.0, 1.0))
        frame = client.get_frame(encoding=ImageEncoding.PNG)
        assert frame.camera is not None
        assert isinstance(frame.world_from_robot, Pose)
        assert frame.robot_from_mirror is not None
        assert frame.stage_ms
        assert frame.plan is not None
        assert frame.plan.startswith("trace")
        down, valid = direction_from_pixel(frame.camera, np.array(frame.camera.centre_px))
        world_from_mirror = frame.world_from_robot @ frame.robot_from_mirror
        assert valid
        assert world_from_mirror.rotate_directions(down) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
        assert frame.world_from_robot.to_rpy()[2] == pytest.approx(1.0)


def test_client_when_the_server_restarts_reconnects(tmp_path: Path) -> None:
    with start_server(tmp_path) as server:
        client = connect_client(server)
        client.spawn(CLASS, start_pose="Centre")
        wait_for_robot(client)
        port = server.stream_port
    with client, start_server(tmp_path, "--stream-port", str(port)):
        assert client.get_frame().robot_name == ""
        with pytest.raises(CatoptraError, match="spawn one first"):
            client.drive(1.0, 1.0)
        client.spawn(CLASS, start_pose="Centre")
        wait_for_robot(client)


def test_server_when_stopped_or_killed_is_lost_long_before_the_deadline(tmp_path: Path) -> None:
    with start_server(tmp_path) as server, connect_client(server) as client:
        client.spawn(CLASS, start_pose="Centre")
        server.process.send_signal(signal.SIGSTOP)
        begin_s = time.monotonic()
        with pytest.raises(ConnectionLostError, match="no heartbeat"):
            client.get_frame()
        server.process.send_signal(signal.SIGCONT)
        assert time.monotonic() - begin_s < MAX_LOSS_S
        wait_for_robot(client)
        server.process.kill()
        begin_s = time.monotonic()
        with pytest.raises(ConnectionLostError):
            client.get_frame()
        assert time.monotonic() - begin_s < MAX_LOSS_S
