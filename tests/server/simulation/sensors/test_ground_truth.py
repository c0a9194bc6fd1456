"""Ground truth: the true pose of robot or sensor."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import Mount, PlanarPose
from catoptra_server.simulation.sensors import MotionStep, SensorContext
from catoptra_server.simulation.sensors.ground_truth import GroundTruthDescription
from helpers.robots import make_instrument, make_sensor

TRUTH = GroundTruthDescription("GroundTruth", 0.2, decimals=2)


def test_reading_is_the_true_pose_for_any_wheel_travel() -> None:
    sensor = make_instrument(TRUTH)
    sensor.update(MotionStep(WheelTravel(5.0, -5.0), 0, 0.02, PlanarPose(0.0, 0.0, 0.0)))
    reading = sensor.read(SensorContext(1.5, 0, Pose.from_rpy((1.0, 2.0, -0.3), (0.1, 0.2, -0.5))))
    assert (reading.time_s, reading.location_m) == (1.5, (1.0, 2.0, -0.3))
    assert reading.rotation_rad == pytest.approx((0.1, 0.2, -0.5))


def test_line_when_sent_has_the_form_of_ut2004() -> None:
    pose = Pose.from_rpy((4.5, 1.9, 1.85), (0.0, 0.0, -0.001))
    reading = make_instrument(TRUTH).read(SensorContext(395.3833, 0, pose))
    assert line_from_report(reading) == (
        b"SEN {Time 395.3833} {Type GroundTruth} {Name GroundTruth} {Location 4.50,1.90,1.85} "
        b"{Orientation 0.00,0.00,6.28}\r\n"
    )


def test_reading_when_more_decimals_are_configured_shows_them() -> None:
    fine = make_instrument(dataclasses.replace(TRUTH, decimals=6))
    reading = fine.read(SensorContext(0.0, 0, Pose.from_rpy((1 / 3, 0, 0))))
    assert b"{Location 0.333333,0.000000,0.000000}" in line_from_report(reading)


def test_configuration_has_its_period_as_captured() -> None:
    (part,) = make_sensor(TRUTH).parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type GroundTruth} {Name GroundTruth} {ScanInterval 0.20}\r\n"
    )


def test_reading_when_not_of_the_robot_is_where_the_sensor_is() -> None:
    mount = Mount((0.0, 0.0, -0.5), (0.0, 0.0, 0.25))
    description = GroundTruthDescription("GroundTruth", 0.2, 2, mount, is_chassis_pose=False)
    pose = Pose.from_rpy((1.0, 2.0, -0.3), (0.0, 0.0, 0.5))
    reading = make_instrument(description).read(SensorContext(0.0, 0, pose))
    assert reading.location_m == pytest.approx((1.0, 2.0, -0.8))
    assert reading.rotation_rad == pytest.approx((0.0, 0.0, 0.75))
