"""Odometry: wheel travel, and each error by itself."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import MotionStep, SensorContext
from catoptra_server.simulation.sensors.odometry import OdometrySensor
from helpers.robots import BASE, ODOMETRY, make_instrument
from helpers.robots import make_sensor as build_sensor

ORIGIN = PlanarPose(0.0, 0.0, 0.0)
TRACK_M = BASE.wheel_separation_m


def make_sensor(*, seed: int = 1, **deviations: Any) -> OdometrySensor:
    odometry = dataclasses.replace(ODOMETRY, **deviations)
    sensor: OdometrySensor = make_instrument(odometry, seed=seed)
    return sensor


def integrate(sensor: OdometrySensor, *ways: WheelTravel) -> tuple[float, float, float]:
    for tick, way in enumerate(ways):
        sensor.update(MotionStep(way, tick, 0.02, ORIGIN))
    reading = sensor.read(SensorContext(0.0, 0, Pose.identity()))
    return reading.x_m, reading.y_m, reading.yaw_rad


def test_pose_at_rest_is_zero_at_any_robot_pose() -> None:
    sensor = make_sensor()
    sensor.update(MotionStep(WheelTravel(0.0, 0.0), 0, 0.02, ORIGIN))
    reading = sensor.read(SensorContext(0.0, 0, Pose.from_rpy((5, 6, 7))))
    assert (reading.name, reading.x_m, reading.y_m, reading.yaw_rad) == ("Odometry", 0, 0, 0)


def test_pose_when_the_right_wheels_lead_turns_counter_clockwise() -> None:
    *_, yaw = integrate(make_sensor(), WheelTravel(0.0, 0.1))
    assert yaw == pytest.approx(-0.1 / TRACK_M)


def test_pose_when_scales_are_off_is_scaled() -> None:
    sensor = make_sensor(distance_scale=1.1, turn_scale=0.5)
    x, y, yaw = integrate(sensor, WheelTravel(1.0, 1.0), WheelTravel(0.1, -0.1))
    assert (x, y, yaw) == pytest.approx((1.1, 0.0, 0.5 * 0.2 / TRACK_M))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_pose_when_drifting_turns_clockwise_in_both_directions(direction: float) -> None:
    *_, yaw = integrate(
        make_sensor(drift_rad_per_m=0.05), *(100 * [WheelTravel(direction, direction)])
    )
    assert yaw == pytest.approx(math.remainder(5.0, 2 * math.pi), abs=1e-12)


@pytest.mark.parametrize("ticks", [10, 200])
@pytest.mark.parametrize(
    ("deviation", "axis", "left_m", "right_m"),
    [
        ("distance_noise_m", 0, 1.0, 1.0),
        ("turn_noise_rad", 2, 0.5 * TRACK_M, -0.5 * TRACK_M),
        ("heading_noise_rad", 2, 1.0, 1.0),
    ],
)
def test_noise_after_one_unit_has_its_spread_for_any_ticks(
    deviation: str, axis: int, left_m: float, right_m: float, ticks: int
) -> None:
    way = WheelTravel(left_m / ticks, right_m / ticks)
    ends = [
        integrate(make_sensor(seed=seed, **{deviation: 0.01}), *(ticks * [way]))[axis]
        for seed in range(200)
    ]
    # The spread of 200 runs is known to 5 % (one sigma).
    assert np.std(ends) == pytest.approx(0.01, rel=0.15)


def test_configuration_has_its_period() -> None:
    (part,) = build_sensor(ODOMETRY).parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type Odometry} {Name Odometry} {ScanInterval 0.2000} {EncoderResolution 0.0000}\r\n"
    )


def test_reset_restarts_from_zero() -> None:
    sensor = make_sensor()
    integrate(sensor, WheelTravel(1.0, 0.9))
    sensor.reset()
    assert integrate(sensor) == (0.0, 0.0, 0.0)
