"""The same seed gives the same bytes: frames and sensor values of a whole server in lockstep.

With any number of other clients and of render threads; another seed gives other values.
"""

from __future__ import annotations

import hashlib
from contextlib import ExitStack
from pathlib import Path

import pytest

from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.long_cases import quick_cases
from helpers.server_process import DEADLINE_S, start_server

CLASS = "USARBot.OmniP2AT"
HOST = "127.0.0.1"
STEPS = 4
SEED = "7"


def run_lockstep(folder: Path, *arguments: str, spectators: int = 0) -> tuple[str, str]:
    """Hashes of all frames and of all sensor values of a run with a robot in motion.

    Args:
        folder: folder of the server's files.
        arguments: further options of the server.
        spectators: number of other clients that request frames between the steps, on both
            transports.
    """
    folder.mkdir()
    frames, values, seen = hashlib.sha256(), hashlib.sha256(), set[bytes]()
    arguments = ("--clock", "lockstep", "--seed", SEED, *arguments)
    with start_server(folder, *arguments) as server, ExitStack() as stack:
        client = stack.enter_context(StreamClient.connect(HOST, server.stream_port, DEADLINE_S))
        client.spawn(CLASS, start_pose="Centre")
        client.drive(2.0, 1.0)
        ports = (f"zmq://{HOST}:{server.stream_port}", f"tcp://{HOST}:{server.image_port}")
        others = [
            stack.enter_context(open_frame_source(ports[i % 2], DEADLINE_S))
            for i in range(spectators)
        ]
        for _ in range(STEPS):
            values.update(repr(client.step(0.2)).encode())
            for other in others:
                other.get_frame()
            frame = client.get_frame(encoding=ImageEncoding.RAW)
            assert frame.world_from_robot is not None
            seen.add(frame.rgb.tobytes())
            frames.update(frame.rgb.tobytes() + frame.world_from_robot.rotation.tobytes())
            frames.update(repr((frame.time_s, frame.camera)).encode())
    # Equal runs show something: the robot moves.
    assert len(seen) == STEPS
    return frames.hexdigest(), values.hexdigest()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The run of one client, rendered by one thread."""
    return run_lockstep(tmp_path_factory.mktemp("reference") / "run")


# A run with both is not equal unless those with either are.
@pytest.mark.parametrize(
    ("arguments", "spectators"),
    quick_cases([((), 0), (("--threads", "2"), 0), ((), 3), (("--threads", "2"), 3)], 3),
    ids=["again", "two threads", "three spectators", "both"],
)
def test_run_when_repeated_gives_the_same_bytes(
    tmp_path: Path, reference: tuple[str, str], arguments: tuple[str, ...], spectators: int
) -> None:
    assert run_lockstep(tmp_path / "run", *arguments, spectators=spectators) == reference


def test_run_when_of_another_seed_has_other_sensor_values(
    tmp_path: Path, reference: tuple[str, str]
) -> None:
    _, values = run_lockstep(tmp_path / "run", "--seed", "8")
    assert values != reference[1]
