"""RFID: tags in reach, in order, through walls."""

from __future__ import annotations

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.sensors import SensorContext, SensorEnvironment
from catoptra_server.world.world_description import RfidTag
from helpers.robots import RFID, make_instrument
from helpers.room_ray_caster import RoomRayCaster

TAGS = (RfidTag(1001, (1.0, 0.0, 0.0)), RfidTag(7, (9.0, 0.0, 0.0)), RfidTag(1010, (0.0, 1.9, 0.0)))


def test_tags_when_in_reach_are_listed_in_the_order_of_the_world() -> None:
    around = SensorEnvironment(RoomRayCaster((0.5, 0.5, 0.5)), rfid_tags=TAGS)
    line = line_from_report(
        make_instrument(RFID).read(SensorContext(395.3833, 0, Pose.identity(), around))
    )
    assert line == b"SEN {Time 395.3833} {Type RFID} {Name RFID} {ID 1001} {ID 1010}\r\n"
