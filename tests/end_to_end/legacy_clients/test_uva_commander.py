"""UvA's UsarCommander and LCM proxy: wait for NFO and start poses; images in legacy mode."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_client.frame import rgb_from_image_bytes
from helpers.legacy_sockets import LineSocket, connect, receive_exactly
from helpers.server_process import RunningServer, start_server

Pose = tuple[float, ...]


class UsarCommander:
    """The connector: waits for NFO, then for the start poses, then spawns at the first pose."""

    def __init__(self, port: int) -> None:
        self.wire = LineSocket(port, size=4096)
        assert self.wire.read_line().startswith("NFO {Gametype")
        self.wire.send("GETSTARTPOSES\r\n")
        self.starts = self._start_poses(self.wire.read_line())

    def spawn(self) -> str:
        """Spawn at the first start pose, and return the pose's name."""
        name = next(iter(self.starts))
        location, rotation = (_format_numbers(self.starts[name][i : i + 3]) for i in (0, 3))
        self.wire.send(
            f"INIT {{ClassName USARBot.OmniP2AT}} {{Name uva}} {{Location {location}}} "
            f"{{Rotation {rotation}}}\r\n"
        )
        return name

    @staticmethod
    def _start_poses(line: str) -> dict[str, Pose]:
        """Poses by name: triples of words in the block behind the count."""
        count, block = re.fullmatch(r"NFO \{StartPoses (\d+)\} \{(.*)\}", line).groups()  # type: ignore[union-attr] # a client that fails here fails the test
        words = block.split(" ")
        assert len(words) == 3 * int(count)
        names, locations, rotations = (words[i::3] for i in range(3))
        both = zip(locations, rotations, strict=True)
        poses = [
            tuple(map(float, f"{location},{rotation}".split(","))) for location, rotation in both
        ]
        return dict(zip(names, poses, strict=True))


def _format_numbers(numbers: Pose) -> str:
    return ",".join(f"{number:.4f}" for number in numbers)


class LegacyViewer:
    """The image side: the first frame needs no request, then OK requests each further one."""

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_frame(self) -> bytes:
        """Read a frame's JPEG, and request the next at once."""
        header = receive_exactly(self.connection, 5)
        assert 1 <= header[0] <= 5
        payload = receive_exactly(self.connection, int.from_bytes(header[1:], "big"))
        self.connection.sendall(b"OK")
        return payload


@pytest.fixture(scope="module")
def legacy_server(tmp_path_factory: pytest.TempPathFactory, room: Path) -> Iterator[RunningServer]:
    """Server in legacy image mode, as ImageSrv was."""
    folder = tmp_path_factory.mktemp("legacy")
    with start_server(folder, "--legacy-images", world=room) as running:
        yield running
        assert running.terminate() == 0


def test_robot_when_start_poses_were_awaited_is_at_the_first(legacy_server: RunningServer) -> None:
    commander = UsarCommander(legacy_server.control_port)
    with commander.wire:
        assert commander.starts == {
            "Robot1": (0.0,) * 6,
            "Robot2": pytest.approx((1.0, 1.0, 0.0, 0.0, 0.0, 1.57)),
        }
        assert commander.spawn() == "Robot1"
        truth = commander.wire.read_line_starting_with("SEN {Time")
    x, y = map(float, re.findall(r"\{Location (\S+),(\S+),\S+\}", truth)[0])
    assert (x, y) == pytest.approx((0.0, 0.0), abs=0.011)


def test_viewer_when_it_waits_for_the_first_frame_receives_all(
    legacy_server: RunningServer,
) -> None:
    commander, viewer = (
        UsarCommander(legacy_server.control_port),
        LegacyViewer(legacy_server.image_port),
    )
    with commander.wire, viewer.connection:
        first = rgb_from_image_bytes(viewer.read_frame())
        commander.spawn()
        commander.wire.read_line_starting_with("STA")
        frames = [rgb_from_image_bytes(viewer.read_frame()) for _ in range(10)]
    assert {frame.shape for frame in (first, *frames)} == {(64, 64, 3)}
    assert not first.any()
    # The red wall and the blue one.
    assert frames[-1][..., 0].max() > 200
    assert frames[-1][..., 2].max() > 200
