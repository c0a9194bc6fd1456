"""The server as a process, through its two TCP ports and the client library."""

from __future__ import annotations

import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.robot_client import RobotClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.usarsim.commands import COMMAND_PARSERS
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.reports import GroundTruthReading
from helpers.configs import FIELD, OMNI_ROBOT, write_small_world
from helpers.server_process import DEADLINE_S, RunningServer, start_server

CLASS = "USARBot.OmniP2AT"


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Server under lockstep; each test spawns its own robots and connects its own viewers."""
    folder = tmp_path_factory.mktemp("lockstep")
    with start_server(folder, "--clock", "lockstep", "--image-type", "RAW") as server:
        yield server
        assert server.terminate() == 0
        assert "Traceback" not in server.log.read_text()


def connect_socket(port: int) -> socket.socket:
    """Connect a socket without any protocol."""
    return socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S)


def test_robot_when_driven_moves_by_the_travel_of_its_wheels(lockstep: RunningServer) -> None:
    with lockstep.connect_robot() as robot:
        robot.spawn(CLASS, start_pose="Centre")
        robot.drive(2.0, 2.0)
        robot.step(2.0)
        assert robot.ground_truth is not None
        # The bundled P2AT slips by 4 mm after 1 m on each side: 0.52 m is certain to some mm.
        assert robot.ground_truth.location_m[0] == pytest.approx(0.52, abs=0.015)
        assert robot.odometry is not None
        assert robot.odometry.x_m == pytest.approx(0.52, abs=0.015)


def test_time_when_stepped_is_printed_exactly(lockstep: RunningServer) -> None:
    with lockstep.connect_robot() as robot:
        robot.spawn(CLASS, start_pose="Centre")
        begin = robot.step(0.0)[-2]
        robot.step(0.2)
        assert isinstance(begin, GroundTruthReading)
        assert robot.ground_truth is not None
        assert robot.ground_truth.time_s == pytest.approx(begin.time_s + 0.2, abs=1e-12)


def test_frame_when_an_object_is_on_the_left_shows_the_object_on_the_right(tmp_path: Path) -> None:
    red = "Boxes=(Size=(X=2,Y=2,Z=2),Position=(X=0,Y=-3,Z=-1),Colour=(R=255),Unlit=true)"
    world = write_small_world(tmp_path, red)
    with (
        start_server(tmp_path, "--image-type", "RAW", world=world) as server,
        server.connect_robot() as robot,
        server.connect_images() as images,
    ):
        robot.spawn(CLASS, location_m=(0.0, 0.0, 0.0))
        pixel, valid = pixel_from_direction(robot.get_camera(), np.array([0.0, -1.0, 0.0]))
        rgb = images.get_frame().rgb
    assert valid
    assert pixel[0] > 32.0
    assert rgb[int(pixel[1]), int(pixel[0])].tolist() == [255, 0, 0]


def test_viewer_without_a_robot_receives_black_frames(lockstep: RunningServer) -> None:
    with lockstep.connect_images() as images:
        assert not images.get_frame().rgb.any()


def test_spawn_of_an_unknown_class_names_those_that_exist(lockstep: RunningServer) -> None:
    robot = RobotClient.connect(port=lockstep.control_port)
    known = "there is no class 'USARBot.Submarine': this server has USARBot.OmniP2AT"
    with robot, pytest.raises(CatoptraError, match=known):
        robot.spawn("USARBot.Submarine", start_pose="Centre")


def test_realtime_server_delivers_status_and_frames_at_once(tmp_path: Path) -> None:
    with (
        start_server(tmp_path, "--image-type", "GOOD") as server,
        server.connect_robot() as robot,
        server.connect_images() as images,
    ):
        robot.spawn(CLASS, start_pose="Centre")
        robot.drive(1.0, -1.0)
        times = [robot.wait_for_report(GroundTruthReading).time_s for _ in range(4)]
        periods = np.diff(times)
        assert (periods > 0.19).all()
        stream = images.iter_frames()
        first = next(stream)
        # Many frames of one tick are equal on a fast machine.
        later = next(
            one for one in islice(stream, 5000) if one.rgb.tobytes() != first.rgb.tobytes()
        )
        assert {first.image_type, later.image_type} == {ImageType.GOOD}
        # Both clients are still connected.
        assert server.terminate(signal.SIGINT) == 130
        assert "Traceback" not in server.log.read_text()


def record_conversation(folder: Path) -> bytes:
    """All bytes that a lockstep server sends for the same commands: reports and frames."""
    folder.mkdir()
    arguments = ("--clock", "lockstep", "--image-type", "RAW")
    with (
        start_server(folder, *arguments) as server,
        connect_socket(server.control_port) as control,
        server.connect_images() as images,
        control.makefile("rb") as lines,
    ):
        received = [lines.readline()]
        control.sendall(b"INIT {ClassName OmniP2AT} {Name R} {Start Centre}\r\n")
        for i in range(5):
            command = f"DRIVE {{Left {1 + i}}} {{Right {3 - i}}}\r\nSTEP {{Time 0.4}}\r\n"
            control.sendall(command.encode())
            while not received[-1].startswith(b"RES"):
                received.append(lines.readline())
            received += [images.get_frame().rgb.tobytes(), b""]
        assert server.terminate() == 0
    return b"".join(received)


def test_lockstep_when_repeated_gives_the_same_bytes_and_frames(tmp_path: Path) -> None:
    # With another seed: test_determinism.py.
    assert record_conversation(tmp_path / "a") == record_conversation(tmp_path / "b")


def malformed_input(seed: int) -> list[bytes]:
    """Inputs of a client that speaks another protocol."""
    random = np.random.default_rng(seed)
    return [
        random.bytes(100_000),
        65_536 * b"x",
        65_536 * b"{",
        b"".join(f"{word} {{Type {{".encode() + b"\r\n" for word in COMMAND_PARSERS),
        b"\x00\xff" * 1000,
        b"U" + struct.pack(">4I", 2**32 - 1, 2**32 - 1, 2**32 - 1, 2**32 - 1),
    ]


@pytest.mark.parametrize("port", ["control_port", "image_port"])
def test_client_when_others_send_garbage_keeps_its_data_and_order(
    lockstep: RunningServer, port: str
) -> None:
    with lockstep.connect_robot() as robot, lockstep.connect_images() as images:
        robot.spawn(CLASS, start_pose="Centre")
        robot.drive(1.0, 1.0)
        times = []
        for data in malformed_input(3):
            with connect_socket(getattr(lockstep, port)) as adversary:
                adversary.sendall(data)
                reports = robot.step(0.2)
                times += [r.time_s for r in reports if isinstance(r, GroundTruthReading)]
                assert images.get_frame().rgb.any()
        assert times == sorted(times)
        # One at the spawn; then two per step: the reading that was due, and the whole cycle's.
        assert len(times) == 1 + 2 * len(malformed_input(3))


def test_server_whose_output_is_full_says_so(tmp_path: Path) -> None:
    arguments = ("--robot", str(OMNI_ROBOT), "--world", str(FIELD), "--control-port", "0")
    command = [sys.executable, "-m", "catoptra_server", *arguments, "--image-port", "0"]
    with Path("/dev/full").open("w") as full:
        process = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S
        )
    assert process.returncode == 1
    assert "standard output takes no line, which has the addresses: No space left" in (
        process.stderr
    )
    assert "--host" not in process.stderr
