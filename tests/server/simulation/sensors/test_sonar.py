"""Sonars: surfaces inside and outside the cone; all in one line."""

from __future__ import annotations

import dataclasses
import math

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors import SensorEnvironment
from catoptra_server.world.objects import OrientedBox
from helpers.robots import SONAR, make_instrument, make_sensor
from helpers.room_ray_caster import RoomRayCaster, context_in_room, oriented_box_at

HALF_ANGLE = 0.5 * SONAR.beam_rad
AT_CHASSIS_ORIGIN = dataclasses.replace(SONAR, mount=Mount())


def test_range_when_facing_a_wall_is_to_the_wall() -> None:
    reading = make_instrument(AT_CHASSIS_ORIGIN).read(context_in_room())
    assert reading.items == (("F1", pytest.approx(4.0)),)


def test_sonar_without_cones_has_its_axis_alone() -> None:
    aside = oriented_box_at(2.0, 0.2, size_m=(0.2, 0.2, 1.0))
    for num_cones, range_m in ((0, 4.0), (1, 1.9)):
        sonar = dataclasses.replace(AT_CHASSIS_ORIGIN, num_cones=num_cones)
        ((_, measured_m),) = make_instrument(sonar).read(context_in_room(aside)).items
        assert measured_m == pytest.approx(range_m, abs=0.05)


@pytest.mark.parametrize(
    ("angle", "is_seen"), [(HALF_ANGLE - 0.02, True), (HALF_ANGLE + 0.12, False)]
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_box_off_axis_is_measured_within_half_the_beam_only(
    angle: float, is_seen: bool, side: float
) -> None:
    # 0.2 m wide at 2 m: 0.05 rad to each side.
    box = oriented_box_at(
        2.0 * math.cos(angle), side * 2.0 * math.sin(angle), size_m=(0.2, 0.2, 1.0)
    )
    ((_, range_m),) = make_instrument(AT_CHASSIS_ORIGIN).read(context_in_room(box)).items
    assert (range_m < 2.1) == is_seen


def test_range_when_too_far_reads_the_maximum() -> None:
    short = dataclasses.replace(AT_CHASSIS_ORIGIN, max_range_m=2.0)
    assert make_instrument(short).read(context_in_room()).items == (("F1", 2.0),)


def test_ring_of_two_reads_each_with_its_own_limits_in_one_line() -> None:
    behind = dataclasses.replace(
        AT_CHASSIS_ORIGIN, name="R1", mount=Mount((-1.0, 0.0, 0.0), (0.0, 0.0, math.pi))
    )
    line = line_from_report(make_instrument(AT_CHASSIS_ORIGIN, behind).read(context_in_room()))
    assert (
        line == b"SEN {Time 1.0000} {Type Sonar} {Name F1 Range 4.0000} {Name R1 Range 3.0000}\r\n"
    )


def test_noise_when_configured_follows_the_tick_alone() -> None:
    noisy = make_instrument(dataclasses.replace(AT_CHASSIS_ORIGIN, noise_m=0.05))
    one, other = (noisy.read(context_in_room(tick=tick)) for tick in (1, 2))
    assert one == noisy.read(context_in_room(tick=1)) != other


def test_parts_are_the_sonars() -> None:
    (part,) = make_sensor(AT_CHASSIS_ORIGIN).parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type Sonar} {Name F1} {MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}\r\n"
    )


# A wall 4 m ahead; the angle of incidence is the angle by which the sonar is turned.
@pytest.mark.parametrize(
    ("turn_rad", "limit_rad", "range_m"),
    [
        (0.1, 0.05, 4.0),  # the cone reaches the wall's nearest point, met at a right angle
        (0.6, 0.5 * math.pi, 3.0 / math.sin(0.75)),  # no limit: the wall aside, met obliquely
        (0.6, 0.5, 4.0 / math.cos(0.45)),  # the cone's other edge
        (0.6, 0.3, 4.0 / math.cos(0.6)),  # the axis alone
    ],
)
def test_echo_when_the_surface_is_flatter_than_the_limit_is_lost(
    turn_rad: float, limit_rad: float, range_m: float
) -> None:
    sonar = dataclasses.replace(
        AT_CHASSIS_ORIGIN,
        mount=Mount((0.0, 0.0, 0.0), (0.0, 0.0, turn_rad)),
        beam_rad=0.3,
        num_cones=30,
        rays_per_cone=64,
        max_incidence_rad=limit_rad,
    )
    ((_, measured_m),) = make_instrument(sonar).read(context_in_room()).items
    # 30 rings and 64 rays sample the angle of incidence to a few milliradians.
    assert measured_m == pytest.approx(range_m, abs=2e-3)


def test_echo_of_an_oblique_box_is_lost() -> None:
    turned = OrientedBox(Pose.from_rpy((2.0, 0.3, 0.0), (0.0, 0.0, 0.8)), (0.4, 0.4, 0.4))
    wide = dataclasses.replace(AT_CHASSIS_ORIGIN, beam_rad=0.6)
    strict = dataclasses.replace(wide, max_incidence_rad=0.2)
    ((_, all_m),), ((_, facing_m),) = (
        make_instrument(s).read(context_in_room(turned)).items for s in (wide, strict)
    )
    assert all_m < 2.0 < 3.9 < facing_m


def test_configuration_of_udk_reports_the_limit() -> None:
    (part,) = make_sensor(
        dataclasses.replace(AT_CHASSIS_ORIGIN, max_incidence_rad=0.1745329252)
    ).parts
    line = line_from_report(part.configuration(), Dialect.UDK)
    assert b"{maxAngleOfIncidence 0.1745} {tracesPerCone 8} {numberOfCones 3}" in line


def test_range_over_a_floor_is_to_the_wall_beyond() -> None:
    # The lowest rays of the cone meet the floor at 0.84 m, 80 degrees from its normal.
    moment = dataclasses.replace(
        context_in_room(), environment=SensorEnvironment(RoomRayCaster((4.0, 3.0, 0.1457)))
    )
    assert make_instrument(AT_CHASSIS_ORIGIN).read(moment).items == (("F1", pytest.approx(4.0)),)
