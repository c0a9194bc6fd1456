"""A server with the robot classes of legacy clients, in a room with walls of different colours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.configs import ROBOTS
from helpers.server_process import RunningServer, start_server, write_small_robot

# Near faces: 4 m ahead, 5 m behind, 2 m on the left (y < 0), 3 m on the right.
ROOM = """[Catoptra.World]
Boxes=(Size=(X=0.2,Y=9,Z=2),Position=(X=4.1,Y=0,Z=-1))
Boxes=(Size=(X=0.2,Y=9,Z=2),Position=(X=-5.1,Y=0,Z=-1))
Boxes=(Size=(X=12,Y=0.2,Z=2),Position=(X=0,Y=-2.1,Z=-1),Colour=(R=255),Unlit=true)
Boxes=(Size=(X=12,Y=0.2,Z=2),Position=(X=0,Y=3.1,Z=-1),Colour=(B=255),Unlit=true)
PlayerStarts=(Tag="Robot1",Location=(X=0,Y=0,Z=0),Rotation=(X=0,Y=0,Z=0))
PlayerStarts=(Tag="Robot2",Location=(X=1,Y=1,Z=0),Rotation=(X=0,Y=0,Z=1.57))
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """World file of the room."""
    path = tmp_path_factory.mktemp("room") / "room.ini"
    path.write_text(ROOM, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, room: Path) -> Iterator[RunningServer]:
    """Serve a P2AT and a small OmniP2AT, for the clients of one module."""
    folder = tmp_path_factory.mktemp("legacy_clients")
    p2at = str(ROBOTS / "p2at.ini")
    with start_server(
        folder, "--robot", p2at, robot=write_small_robot(folder), world=room
    ) as running:
        yield running
        assert running.terminate() == 0
        assert "Traceback" not in running.log.read_text()
