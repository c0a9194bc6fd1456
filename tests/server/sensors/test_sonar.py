"""Sonars: what is in the cone and what is not; all in one line."""

from __future__ import annotations

import dataclasses
import math

import pytest

from catoptra_protocol.wire.reports import line_from_report
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import Mount, SonarDescription
from catoptra_server.sensors.sonar import SonarRing
from helpers.robots import BASE, SONAR
from helpers.rooms import box_at, in_room

HALF_ANGLE = 0.5 * SONAR.beam_rad
CENTRED = dataclasses.replace(SONAR, mount=Mount())


def ring(*sonars: SonarDescription) -> SonarRing:
    return SonarRing(sonars or (CENTRED,), BASE, RandomStream.of(1, "R", "sonars"))


def test_range_when_facing_a_wall_is_to_the_wall() -> None:
    assert ring().reading(in_room()).items == (("F1", pytest.approx(4.0)),)


@pytest.mark.parametrize(
    ("angle", "is_seen"), [(HALF_ANGLE - 0.02, True), (HALF_ANGLE + 0.12, False)]
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_box_when_off_axis_is_seen_within_half_the_beam_only(
    angle: float, is_seen: bool, side: float
) -> None:
    # 0.2 m wide at 2 m: it covers 0.05 rad to each side.
    box = box_at(2.0 * math.cos(angle), side * 2.0 * math.sin(angle), size_m=(0.2, 0.2, 1.0))
    ((_, range_m),) = ring().reading(in_room(box)).items
    assert (range_m < 2.1) == is_seen


def test_range_when_too_far_reads_the_maximum() -> None:
    short = dataclasses.replace(CENTRED, max_range_m=2.0)
    assert ring(short).reading(in_room()).items == (("F1", 2.0),)


def test_ring_when_of_two_reads_each_with_its_own_limits_in_one_line() -> None:
    behind = dataclasses.replace(
        CENTRED, name="R1", mount=Mount((-1.0, 0.0, 0.0), (0.0, 0.0, math.pi))
    )
    line = line_from_report(ring(CENTRED, behind).reading(in_room()))
    assert (
        line == b"SEN {Time 1.0000} {Type Sonar} {Name F1 Range 4.0000} {Name R1 Range 3.0000}\r\n"
    )


def test_noise_when_configured_follows_the_tick_alone() -> None:
    noisy = ring(dataclasses.replace(CENTRED, noise_m=0.05))
    one, other = (noisy.reading(in_room(tick=tick)) for tick in (1, 2))
    assert one == noisy.reading(in_room(tick=1)) != other


def test_parts_when_asked_are_the_sonars() -> None:
    (part,) = ring().parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type Sonar} {Name F1} {MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}\r\n"
    )
