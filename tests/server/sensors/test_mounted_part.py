"""A part's answers."""

from __future__ import annotations

from catoptra_protocol.usarsim.reports import Configuration, GeometryItem
from catoptra_server.robot.mount import Mount
from catoptra_server.sensors.mounted_part import MountedPart


def test_part_when_asked_tells_what_it_was_given() -> None:
    told = Configuration("RFID", (("Name", "R"),))
    part = MountedPart("RFID", "R", Mount((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt"), told)
    assert part.configuration() is told
    assert part.geometry() == GeometryItem("R", (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt")
