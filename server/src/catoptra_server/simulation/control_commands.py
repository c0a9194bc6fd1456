"""Commands that need a robot with power: motion of wheels, joints and packages, SET, viewports."""

from __future__ import annotations

from typing import assert_never

from catoptra_protocol.usarsim.commands import (
    Drive,
    DriveJoints,
    MisPkg,
    MultiDrive,
    Set,
    SetViewports,
    Trace,
)
from catoptra_protocol.usarsim.reports import Report
from catoptra_server.simulation.robot import EnvironmentProvider, Robot
from catoptra_server.simulation.set_commands import execute_set

# The others are executed without power, as in USARSim.
ControlCommand = Drive | DriveJoints | MultiDrive | MisPkg | Set | SetViewports | Trace


def execute_control(
    robot: Robot, command: ControlCommand, time_s: float, sense: EnvironmentProvider
) -> list[Report]:
    """Execute a command of a robot that has power; its reports, mostly none.

    Args:
        sense: Environment of the robot, computed only for commands that read sensors.
    """
    match command:
        case Drive():
            robot.drive_wheels(command, time_s)
        case DriveJoints(joints):
            for joint in joints:
                robot.drive_joint(joint.name, joint.value, joint.order)
        case MultiDrive(joints):
            for name, value in joints:
                robot.drive_joint(name, value, 0)
        case MisPkg():
            robot.drive_mission_package(command)
        case SetViewports():
            return [robot.viewports.execute(command, time_s)]
        case Set():
            return execute_set(robot, command, robot.sensor_context(time_s, sense()))
        case Trace():
            pass  # accepted: the colour trail of the original editor has no counterpart
        case _:
            assert_never(command)
    return []
