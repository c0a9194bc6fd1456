"""Ground truth: the pose as it is."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.reports import line_from_report
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import GroundTruthDescription, Mount
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.robot.skid_steer import Rolled
from catoptra_server.sensors import Moment, Move
from catoptra_server.sensors.ground_truth import GroundTruthSensor
from helpers.robots import BASE


def sensor_of(decimals: int = 2) -> GroundTruthSensor:
    description = GroundTruthDescription("GroundTruth", 0.2, decimals)
    return GroundTruthSensor(description, BASE, RandomStream.of(1, "GroundTruth"))


def test_reading_when_taken_is_the_pose_whatever_the_wheels_did() -> None:
    sensor = sensor_of()
    sensor.follow(Move(Rolled(5.0, -5.0), 0, 0.02, PlanarPose(0.0, 0.0, 0.0)))
    reading = sensor.reading(Moment(1.5, 0, Pose.from_rpy((1.0, 2.0, -0.3), (0.1, 0.2, -0.5))))
    assert (reading.time_s, reading.location_m) == (1.5, (1.0, 2.0, -0.3))
    assert reading.rotation_rad == pytest.approx((0.1, 0.2, -0.5))


def test_line_when_sent_has_the_form_of_ut2004() -> None:
    pose = Pose.from_rpy((4.5, 1.9, 1.85), (0.0, 0.0, -0.001))
    reading = sensor_of().reading(Moment(395.3833, 0, pose))
    assert line_from_report(reading) == (
        b"SEN {Time 395.3833} {Type GroundTruth} {Name GroundTruth} {Location 4.50,1.90,1.85} "
        b"{Orientation 0.00,0.00,6.28}\r\n"
    )


def test_reading_when_more_decimals_are_configured_shows_them() -> None:
    reading = sensor_of(6).reading(Moment(0.0, 0, Pose.from_rpy((1 / 3, 0, 0))))
    assert b"{Location 0.333333,0.000000,0.000000}" in line_from_report(reading)


def test_configuration_when_asked_has_its_period_as_captured() -> None:
    (part,) = sensor_of().parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type GroundTruth} {Name GroundTruth} {ScanInterval 0.20}\r\n"
    )


def test_reading_when_not_of_the_robot_is_where_the_sensor_is() -> None:
    mount = Mount((0.0, 0.0, -0.5), (0.0, 0.0, 0.25))
    description = GroundTruthDescription("GroundTruth", 0.2, 2, mount, is_of_robot=False)
    sensor = GroundTruthSensor(description, BASE, RandomStream.of(1, "GroundTruth"))
    reading = sensor.reading(Moment(0.0, 0, Pose.from_rpy((1.0, 2.0, -0.3), (0.0, 0.0, 0.5))))
    assert reading.location_m == pytest.approx((1.0, 2.0, -0.8))
    assert reading.rotation_rad == pytest.approx((0.0, 0.0, 0.75))
