"""Commands to one robot: wheels, joints, packages, SET, GETCONF, GETGEO; and who may drive whom.

Each command returns reports. A part that the robot does not have gets an empty reply to GETCONF and
GETGEO, and a RES of Failed to SET. A robot whose owner shares control may be driven by other
clients. The robot halts once that driver disconnects or may not drive any more.

To add an opcode of SET: a handler below, and its line in `_HANDLERS`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, assert_never

from catoptra_protocol.errors import DomainError
from catoptra_protocol.usarsim.command_results import STATUS_FAILED, STATUS_OK
from catoptra_protocol.usarsim.commands import (
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    MisPkg,
    MultiDrive,
    SetCommand,
    SetViewports,
    Trace,
)
from catoptra_protocol.usarsim.reports import (
    CameraConfiguration,
    CameraFov,
    CameraResult,
    CommandResult,
    Configuration,
    Geometry,
    GeometryItem,
    MissionPackageGeometry,
    Report,
    VehicleConfiguration,
    VehicleGeometry,
)
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.error_bound import ErrorBound
from catoptra_server.simulation.events import Client, RejectedError
from catoptra_server.simulation.robot import EnvironmentProvider, Robot
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import Part, SensorContext
from catoptra_server.simulation.sensors.omni_camera import OmniCameraSensor

ErrorBoundLookup = Callable[[OmniCameraSpec], ErrorBound | None]
# The others are executed without power, as in USARSim.
_ControlCommand = Drive | DriveJoints | MultiDrive | MisPkg | SetCommand | SetViewports | Trace


def execute_control(
    robot: Robot, command: _ControlCommand, time_s: float, sense: EnvironmentProvider
) -> list[Report]:
    """Execute a command of a robot that has power; the reports, mostly none.

    Args:
        sense: Environment of the robot, computed only for commands that read sensors.
    """
    if not isinstance(command, Drive):  # which others may send, too
        robot.commands.add(command, time_s)
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
        case SetCommand():
            return _execute_set(robot, command, robot.sensor_context(time_s, sense()))
        case Trace():
            pass  # accepted: the colour trail of the original editor has no counterpart
        case _:
            assert_never(command)
    return []


def execute_get_conf(
    robot: Robot, command: GetConf, error_bound_of: ErrorBoundLookup = lambda camera: None
) -> list[Report]:
    """Configuration of the robot, or of the parts of a type, one CONF a part as in UT2004.

    Args:
        error_bound_of: Error bound of a camera; None before the first frame.
    """
    if _is_robot(command.type):
        return [vehicle_configuration(robot.description)]
    # An empty reply rather than none: clients wait for a line of the requested type.
    parts = _find_named_parts(robot, command.type, command.name)
    empty = Configuration(command.type, (("Name", command.name),) if command.name else ())
    return [_configuration(part, error_bound_of) for part in parts] or [empty]


def execute_get_geo(robot: Robot, command: GetGeo) -> list[Report]:
    """Geometry of the robot, or of the parts of a type: one GEO for all, or one a package."""
    if _is_robot(command.type):
        return [vehicle_geometry(robot.description)]
    found = [part.geometry() for part in _find_named_parts(robot, command.type, command.name)]
    packages = [one for one in found if isinstance(one, MissionPackageGeometry)]
    items = tuple(one for one in found if isinstance(one, GeometryItem))
    # A package's GEO lists links, which the common form of the other parts cannot hold.
    if packages and not items:
        return [*packages]
    # The name is echoed only in an empty reply: items carry their own names.
    name = None if items else command.name
    return [Geometry(command.type, items, name, robot.description.model_name)]


_HALT = Drive(0.0, 0.0)


class RemoteControl:
    """Who drives whose robot. A robot halts once its driver disconnects or may not drive it."""

    def __init__(self, robots: Mapping[Client, Robot]) -> None:
        """Begin with robots that their owners drive.

        Args:
            robots: Robots by owner; a view, in which robots come and go.
        """
        self._robots = robots
        # Driver by owner, for the robots that roll by the command of another client.
        self._drivers: dict[Client, Client] = {}

    def drive(self, client: Client, name: str, drive: Drive, time_s: float) -> None:
        """Drive the robot of a name.

        Raises:
            RejectedError: There is none, or its owner does not share its control.
        """
        found = next((item for item in self._robots.items() if item[1].name == name), None)
        if found is None:
            raise RejectedError(f"there is no robot {name!r}")
        owner, robot = found
        if owner is not client and not robot.shares_control:
            raise RejectedError(
                f"the owner of robot {name!r} does not share its control (share_control)"
            )
        robot.drive_wheels(drive, time_s)
        self._drivers.pop(owner, None)
        if owner is not client and robot.is_rolling:
            self._drivers[owner] = client

    def release(self, owner: Client) -> None:
        """Record that the owner drives the robot itself, or has none any more."""
        self._drivers.pop(owner, None)

    def share(self, owner: Client, shared: bool, time_s: float) -> None:
        """Let others drive the robot of a client, or no longer; without a robot of no effect."""
        robot = self._robots.get(owner)
        if robot is not None:
            robot.shares_control = shared
            if not shared:
                self._halt(owner, time_s)

    def halt_robots_driven_by(self, client: Client, time_s: float) -> None:
        """Halt the robots that roll by the command of a client that disconnects."""
        for owner in [owner for owner, driver in self._drivers.items() if driver is client]:
            self._halt(owner, time_s)

    def _halt(self, owner: Client, time_s: float) -> None:
        """Halt a robot that another client drives."""
        if self._drivers.pop(owner, None) is not None:
            self._robots[owner].drive_wheels(_HALT, time_s)


# The readings that SET requests; None for Failed.
_Readings = list[Report] | None


def _execute_set(robot: Robot, command: SetCommand, context: SensorContext) -> list[Report]:
    """Execute SET of a part.

    Returns:
        The readings that the command requests, such as the scan of SCAN, then the RES.
    """
    # SET Camera FOV carries a value in place of an opcode, and has a RES of its own form.
    if command.type.lower() == "camera" and command.parse_fov_rad() is not None:
        return [_zoom(robot, command, context.time_s)]
    handler = _HANDLERS.get((command.type.lower(), (command.opcode or "").lower()))
    readings = handler(robot, command, context) if handler else None
    status = STATUS_FAILED if readings is None else STATUS_OK
    result = CommandResult(context.time_s, command.type, command.name or "", status)
    return [*(readings or ()), result]


def _zoom(robot: Robot, command: SetCommand, time_s: float) -> Report:
    """Zoom the perspective camera of a name, or all."""
    requested = command.parse_fov_rad() or 0.0
    cameras = [
        CameraFov(c.name, c.zoom(requested))
        for c in robot.perspective_cameras
        if _matches_name(command, c.name)
    ]
    # Mirror and lens fix an omnidirectional camera's model. The camera fails by name, or where the
    # robot has no other, but does not spoil a zoom of all perspective cameras.
    if command.name or not cameras:
        cameras += [
            CameraFov(omni.name, omni.capture_fov_rad, STATUS_FAILED)
            for omni in robot.omni_cameras
            if _matches_name(command, omni.name)
        ]
    if not cameras:
        return CommandResult(time_s, command.type, command.name or "", STATUS_FAILED)
    return CameraResult(time_s, tuple(cameras))


# Any: the type of the command says which class the instruments have.
def _find_instruments(robot: Robot, command: SetCommand) -> list[Any]:
    """Instruments of the command's type: that of the command's name, or all."""
    type_ = command.type.lower()
    alike = [sensor for sensor in robot.sensors if sensor.type.lower() == type_]
    return [sensor.instrument for sensor in alike if _matches_name(command, sensor.name)]


def _reset_odometry(robot: Robot, command: SetCommand, context: SensorContext) -> _Readings:
    found = _find_instruments(robot, command)
    for sensor in found:
        sensor.reset()
    return [] if found else None


def _reset_encoder(robot: Robot, command: SetCommand, context: SensorContext) -> _Readings:
    # One bank has the robot's encoders, whose names it knows.
    banks: list[Any] = [s.instrument for s in robot.sensors if s.type.lower() == "encoder"]
    # A list inside any(): every bank is reset, not only the first that has the name.
    return [] if any([bank.reset(command.name, context) for bank in banks]) else None


def _set_ins_pose(robot: Robot, command: SetCommand, context: SensorContext) -> _Readings:
    found = _find_instruments(robot, command)
    numbers = command.numeric_params
    # x, y, z, roll, pitch, yaw; a part of a pose is no pose.
    if len(numbers) != 6:
        return None
    x, y, z, roll, pitch, yaw = numbers
    for sensor in found:
        sensor.set_pose((x, y, z), (roll, pitch, yaw), context.world_from_robot)
    return [] if found else None


def _scan(robot: Robot, command: SetCommand, context: SensorContext) -> _Readings:
    # Beside the periodic scans, whose schedule does not change.
    found = _find_instruments(robot, command)
    return [sensor.read(context) for sensor in found] or None


def _set_accuracy_target(
    robot: Robot, command: SetCommand, context: SensorContext, *, field: str
) -> _Readings:
    """Set one value of an accuracy target, of all omnidirectional cameras without a name."""
    omnis = [omni for omni in robot.omni_cameras if _matches_name(command, omni.name)]
    numbers = command.numeric_params
    if not omnis or len(numbers) != 1:
        return None
    try:
        for omni in omnis:
            omni.set_accuracy_target(**{field: numbers[0]})
    # A negative value, which SET reports by Failed instead of an error.
    except DomainError:
        return None
    return []


# By type and opcode in lower case.
_HANDLERS: dict[tuple[str, str], Callable[[Robot, SetCommand, SensorContext], _Readings]] = {
    ("odometry", "reset"): _reset_odometry,
    ("encoder", "reset"): _reset_encoder,
    ("ins", "pose"): _set_ins_pose,
    ("rangescanner", "scan"): _scan,
    ("camera", "maxerror"): partial(_set_accuracy_target, field="max_error_px"),
    ("camera", "budget"): partial(_set_accuracy_target, field="budget_ms"),
}


def _matches_name(command: SetCommand, name: str) -> bool:
    return command.name is None or command.name.lower() == name.lower()


def _configuration(part: Part, error_bound_of: ErrorBoundLookup) -> Report:
    """CONF of a part, with the error bound where the part is a camera that has one."""
    configuration = part.configuration()
    # Of the camera as tiled: that view is rendered for the image port.
    bound = (
        error_bound_of(part.camera_spec(part.tile)) if isinstance(part, OmniCameraSensor) else None
    )
    if bound is None or not isinstance(configuration, CameraConfiguration):
        return configuration
    pairs = (
        ("ErrorBoundPx", format_fixed_point(bound.outline_error_px, 6)),
        ("ErrorRmsPx", format_fixed_point(bound.geometric.rms_px, 6)),
    )
    return dataclasses.replace(configuration, extra_pairs=(*configuration.extra_pairs, *pairs))


def vehicle_configuration(description: RobotDescription) -> VehicleConfiguration:
    """CONF of a robot itself."""
    drive = description.drive
    return VehicleConfiguration(
        name=description.model_name,
        mass_kg=drive.mass_kg,
        max_speed_rad_s=drive.max_speed_rad_s,
        max_torque=drive.max_torque,
    )


def vehicle_geometry(description: RobotDescription) -> VehicleGeometry:
    """GEO of a robot itself."""
    drive = description.drive
    return VehicleGeometry(
        name=description.model_name,
        dimensions_m=drive.dimensions_m,
        centre_of_gravity_m=(0.0, 0.0, 0.0),
        wheel_radius_m=drive.wheel_radius_m,
        wheel_separation_m=drive.wheel_separation_m,
        wheel_base_m=drive.wheel_base_m,
    )


def _is_robot(type_: str) -> bool:
    """Whether the type is the robot itself, which replies under its model's name."""
    # The name is not compared: clients send the spawned name, the class or none.
    return type_.lower() == "robot"


def _find_named_parts(robot: Robot, type_: str, name: str | None) -> list[Part]:
    return [
        p for p in robot.find_parts_of_type(type_) if name is None or p.name.lower() == name.lower()
    ]
