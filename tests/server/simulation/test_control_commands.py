"""Commands that need power, on a robot by itself."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.commands import Drive, Set, Trace
from catoptra_protocol.usarsim.reports import CommandResult
from catoptra_server.simulation.commands import ControlCommand, execute_control
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors.sensor import EMPTY_ENVIRONMENT, SensorEnvironment
from helpers.robots import make_p2at


def make_robot() -> Robot:
    return Robot(make_p2at(), PlanarPose(0.0, 0.0, 0.0), name="R", seed=1, time_s=0.0)


def refuse_to_sense() -> SensorEnvironment:
    raise AssertionError("the command reads no sensor")


def test_drive_sets_the_wheels_and_reports_nothing() -> None:
    robot = make_robot()
    assert execute_control(robot, Drive(1.0, 2.0), 0.0, refuse_to_sense) == []
    assert robot.wheel_speeds_rad_s == (1.0, 2.0)


def test_trace_is_accepted_without_a_reply() -> None:
    command: ControlCommand = Trace(True, 1.0, "Red")
    assert execute_control(make_robot(), command, 0.0, refuse_to_sense) == []


@pytest.mark.parametrize(("name", "status"), [("Odometry", "OK"), ("Other", "Failed")])
def test_set_reports_its_result(name: str, status: str) -> None:
    command = Set("Odometry", name, "RESET", None)
    (result,) = execute_control(make_robot(), command, 0.0, lambda: EMPTY_ENVIRONMENT)
    assert isinstance(result, CommandResult)
    assert result.status == status
