"""GPS: degrees from metres, and no fix under a roof."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import GpsReading
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors import (
    EmptyScene,
    RayCaster,
    SensorContext,
    SensorEnvironment,
)
from catoptra_server.simulation.sensors.gps import GpsDescription
from catoptra_server.world.world_description import GpsOrigin
from helpers.robots import GPS, make_instrument
from helpers.room_ray_caster import RoomRayCaster

ORIGIN = GpsOrigin(39.1339, -77.2166)
AT_CHASSIS_ORIGIN = dataclasses.replace(GPS, mount=Mount())


def read(
    scene: RayCaster,
    origin: GpsOrigin | None = ORIGIN,
    description: GpsDescription = AT_CHASSIS_ORIGIN,
    tick: int = 0,
) -> GpsReading:
    around = SensorEnvironment(scene, gps_origin=origin)
    context = SensorContext(0.0, tick, Pose.from_rpy((1000.0, 1000.0, 0.0)), around)
    reading: GpsReading = make_instrument(description).read(context)
    return reading


def test_fix_when_under_the_open_sky_is_of_all_satellites() -> None:
    reading = read(EmptyScene())
    assert (reading.has_fix, reading.num_satellites) == (True, 11)


def test_fix_when_under_a_roof_or_without_an_origin_is_none() -> None:
    assert read(RoomRayCaster((2000.0, 2000.0, 2.0))) == GpsReading("GPS")
    assert read(EmptyScene(), None) == GpsReading("GPS")


@pytest.mark.parametrize(
    ("latitude", "metres_a_degree", "east_metres_a_degree"),
    # Tables of the lengths of a degree on WGS 84, to the metre.
    [(0.0, 110_574, 111_320), (45.0, 111_132, 78_847), (60.0, 111_412, 55_800)],
)
def test_degrees_when_far_are_as_long_as_on_the_ellipsoid(
    latitude: float, metres_a_degree: float, east_metres_a_degree: float
) -> None:
    reading = read(EmptyScene(), GpsOrigin(latitude, 10.0))
    assert 1000.0 / (reading.latitude_deg - latitude) == pytest.approx(metres_a_degree, abs=1.0)
    assert 1000.0 / (reading.longitude_deg - 10.0) == pytest.approx(east_metres_a_degree, abs=1.0)


def test_noise_when_configured_moves_the_position_by_its_spread() -> None:
    noisy = dataclasses.replace(AT_CHASSIS_ORIGIN, noise_m=2.0)
    north = [read(EmptyScene(), description=noisy, tick=t).latitude_deg for t in range(300)]
    assert np.std(north) * 111_016 == pytest.approx(2.0, rel=0.15)
