"""Victims: in view, occluded, beside the field of view, out of range."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.sensors import SensorContext, SensorEnvironment
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.world_description import Victim
from helpers.robots import VICTIMS, make_instrument
from helpers.room_ray_caster import RoomRayCaster, oriented_box_at


def report_line(place: tuple[float, float, float], *boxes: OrientedBox) -> bytes:
    around = SensorEnvironment(
        RoomRayCaster((20.0, 20.0, 2.0)), boxes, victims=(Victim("Head", place),)
    )
    sensor = make_instrument(VICTIMS)
    return line_from_report(sensor.read(SensorContext(395.9927, 0, Pose.identity(), around)))


def test_victim_in_view_is_reported_with_its_position() -> None:
    assert report_line((2.1, 0.5, -0.05)) == (
        b"SEN {Time 395.9927} {Type VictSensor} {Name VictSensor} {PartName Head} "
        b"{Location 2.00,0.50,0.00}\r\n"
    )


@pytest.mark.parametrize("place", [(6.0, 0.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])
def test_victim_when_too_far_or_aside_is_none(place: tuple[float, float, float]) -> None:
    assert report_line(place) == (
        b"SEN {Time 395.9927} {Type VictSensor} {Name VictSensor} {Status NoVictims}\r\n"
    )


def test_victim_behind_a_surface_is_occluded() -> None:
    assert b"NoVictims" in report_line((3.0, 0.0, 0.0), oriented_box_at(1.5, 0.0))
