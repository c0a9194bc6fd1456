"""Replies of a mounted part."""

from __future__ import annotations

from catoptra_protocol.usarsim.reports import Configuration, GeometryItem
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors.sensor import MountedPart


def test_part_replies_with_its_configuration_and_mount() -> None:
    expected = Configuration("RFID", (("Name", "R"),))
    part = MountedPart("RFID", "R", Mount((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt"), expected)
    assert part.configuration() is expected
    assert part.geometry() == GeometryItem("R", (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt")
