"""Inertial navigation: true without noise, drifting with time, corrected by SET POSE."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import MotionStep, SensorContext
from catoptra_server.simulation.sensors.ins import InsSensor
from helpers.robots import INS, make_instrument

POSE = Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5))


def make_sensor(seed: int = 1, **changes: object) -> InsSensor:
    sensor: InsSensor = make_instrument(dataclasses.replace(INS, **changes), seed=seed)  # type: ignore[arg-type] # a test's own
    return sensor


def error_after_standing(sensor: InsSensor, *, ticks: int, tick_s: float) -> tuple[float, ...]:
    for tick in range(ticks):
        sensor.update(MotionStep(WheelTravel(0.0, 0.0), tick, tick_s, PlanarPose(0.0, 0.0, 0.0)))
    reading = sensor.read(SensorContext(0.0, ticks, Pose.identity()))
    return (reading.location_m[0], reading.location_m[1], reading.rotation_rad[2])


def test_reading_when_without_noise_is_where_the_sensor_is() -> None:
    reading = make_sensor().read(SensorContext(0.0, 0, POSE))
    assert reading.location_m == pytest.approx(
        tuple(POSE.transform_points(np.array(INS.mount.position_m)))
    )
    assert reading.rotation_rad == pytest.approx((0.0, 0.0, 0.5))


@pytest.mark.parametrize(("ticks", "tick_s"), [(50, 0.02), (10, 0.1)])
def test_drift_after_a_second_has_its_spread_for_any_ticks(ticks: int, tick_s: float) -> None:
    ends = [
        error_after_standing(make_sensor(seed, noise=0.01), ticks=ticks, tick_s=tick_s)
        for seed in range(300)
    ]
    # Relative to the mount's own 0.1 m in x; 300 runs know a spread to 4 %.
    assert np.std(ends, axis=0) == pytest.approx(0.01, rel=0.15)
    assert np.mean(ends, axis=0) == pytest.approx((0.1, 0.0, 0.0), abs=0.002)


def test_drift_grows_with_the_root_of_time() -> None:
    spreads = [
        np.std(
            [
                error_after_standing(make_sensor(s, noise=0.01), ticks=n, tick_s=0.5)
                for s in range(200)
            ],
            axis=0,
        )
        for n in (2, 32)
    ]
    assert spreads[1] / spreads[0] == pytest.approx(4.0, rel=0.25)


def test_noise_when_not_drifting_is_of_each_reading_alone() -> None:
    sensor = make_sensor(noise=0.01, is_drifting=False)
    readings = [sensor.read(SensorContext(0.0, tick, POSE)).rotation_rad[2] for tick in range(400)]
    assert np.std(readings) == pytest.approx(0.01, rel=0.1)


def test_pose_when_set_is_reported_from_then_on() -> None:
    sensor = make_sensor()
    sensor.set_pose((5.0, 6.0, 0.0), (0.0, 0.0, 3.0), POSE)
    reading = sensor.read(SensorContext(0.0, 0, POSE))
    assert reading.location_m[:2] == pytest.approx((5.0, 6.0))
    assert reading.rotation_rad[2] == pytest.approx(3.0)


@pytest.mark.parametrize("is_drifting", [True, False])
def test_pose_when_set_includes_height_roll_and_pitch(is_drifting: bool) -> None:
    sensor = make_sensor(is_drifting=is_drifting)
    sensor.set_pose((5.0, 6.0, -1.8), (0.3, -0.2, 3.0), POSE)
    sensor.update(MotionStep(WheelTravel(0.0, 0.0), 1, 0.02, PlanarPose(0.0, 0.0, 0.0)))
    reading = sensor.read(SensorContext(0.0, 1, POSE))
    assert reading.location_m == pytest.approx((5.0, 6.0, -1.8))
    assert reading.rotation_rad == pytest.approx((0.3, -0.2, 3.0))


def test_pose_when_set_stays_relative_to_a_robot_that_is_lifted_and_tilted() -> None:
    sensor = make_sensor()
    sensor.set_pose((0.0, 0.0, 2.0), (0.5, 0.0, 0.0), Pose.identity())
    mounted_at_m = sensor.read(SensorContext(0.0, 1, Pose.identity())).location_m
    lifted = Pose.from_rpy((0.0, 0.0, -0.5), (0.1, 0.0, 0.0))
    reading = sensor.read(SensorContext(0.0, 1, lifted))
    assert mounted_at_m[2] == pytest.approx(2.0)
    assert reading.location_m[2] == pytest.approx(1.5, abs=0.02)  # the mount leans with the robot
    assert reading.rotation_rad[0] == pytest.approx(0.6)


def error_after_driving(
    sensor: InsSensor, distance_m: float, turn_rad: float, *, ticks: int
) -> tuple[float, ...]:
    """Errors of x, y and yaw after a drive out and a turn, in a number of ticks."""
    for tick in range(ticks + 1):
        done = tick / ticks
        pose = PlanarPose(done * distance_m, 0.0, done * turn_rad)
        sensor.update(MotionStep(WheelTravel(1.0, 1.0), tick, 0.02, pose))
    pose = Pose.from_rpy((distance_m, 0.0, 0.0), (0.0, 0.0, turn_rad))
    reading = sensor.read(SensorContext(0.0, ticks, pose))
    place = pose.transform_points(np.array(INS.mount.position_m))
    return (
        reading.location_m[0] - place[0],
        reading.location_m[1] - place[1],
        reading.rotation_rad[2] - turn_rad,
    )


def test_bias_when_precise_to_a_thousand_is_up_to_half_a_millimetre_a_metre() -> None:
    errors = [
        error_after_driving(make_sensor(s, precision=1000.0), 2.0, 0.5, ticks=10)
        for s in range(300)
    ]
    # Uniform: 2 m make at most 1 mm, 0.5 rad at most 0.25 microradians.
    assert np.abs(errors).max(axis=0) == pytest.approx((1e-3, 1e-3, 2.5e-7), rel=0.05)
    assert np.mean(errors, axis=0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)


def test_bias_does_not_depend_on_the_ticks() -> None:
    coarse, fine = (
        error_after_driving(make_sensor(precision=10.0), 2.0, 0.5, ticks=n) for n in (4, 64)
    )
    assert coarse == pytest.approx(fine)
    assert coarse[0] != 0.0


@pytest.mark.parametrize("changes", [{"precision": 0.0}, {"precision": 9.0, "is_drifting": False}])
def test_bias_without_precision_is_zero(changes: dict[str, object]) -> None:
    assert error_after_driving(make_sensor(**changes), 2.0, 0.5, ticks=4) == pytest.approx(
        (0.0, 0.0, 0.0)
    )


@pytest.mark.parametrize(("is_timed", "time_s"), [(True, 1.5), (False, None)])
def test_time_when_configured_is_reported(is_timed: bool, time_s: float | None) -> None:
    assert make_sensor(has_timestamp=is_timed).read(SensorContext(1.5, 0, POSE)).time_s == time_s
