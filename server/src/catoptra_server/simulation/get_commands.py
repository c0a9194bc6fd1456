"""Replies to GETCONF and GETGEO; a type or name that the robot lacks has an empty reply."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from catoptra_protocol.usarsim.commands import GetConf, GetGeo
from catoptra_protocol.usarsim.reports import (
    CameraConfiguration,
    Configuration,
    Geometry,
    GeometryItem,
    MissionPackageGeometry,
    Report,
    VehicleConfiguration,
    VehicleGeometry,
)
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.sensors import Part
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.robot import Robot

ErrorBoundLookup = Callable[[OmniCameraSpec], ErrorBound | None]


def execute_get_conf(
    robot: Robot, command: GetConf, error_bound_of: ErrorBoundLookup = lambda camera: None
) -> list[Report]:
    """Configuration of the robot, or of its parts of a type, one CONF a part as in UT2004.

    Args:
        error_bound_of: Error bound of a camera; None before the first frame.
    """
    if _is_robot(command.type):
        return [_vehicle_configuration(robot.description)]
    # An empty reply rather than none: clients wait for a line of the requested type.
    parts = _find_parts(robot, command.type, command.name)
    empty = Configuration(command.type, (("Name", command.name),) if command.name else ())
    return [_configuration(part, error_bound_of) for part in parts] or [empty]


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


def _vehicle_configuration(description: RobotDescription) -> VehicleConfiguration:
    drive = description.drive
    return VehicleConfiguration(
        name=description.model_name,
        mass_kg=drive.mass_kg,
        max_speed_rad_s=drive.max_speed_rad_s,
        max_torque=drive.max_torque,
    )


def execute_get_geo(robot: Robot, command: GetGeo) -> list[Report]:
    """Geometry of the robot, or of its parts of a type: one GEO for all, or one a package."""
    if _is_robot(command.type):
        return [_vehicle_geometry(robot.description)]
    found = [part.geometry() for part in _find_parts(robot, command.type, command.name)]
    packages = [one for one in found if isinstance(one, MissionPackageGeometry)]
    items = tuple(one for one in found if isinstance(one, GeometryItem))
    # A package's GEO lists links, which the common form of the other parts cannot hold.
    if packages and not items:
        return [*packages]
    # The name is echoed only in an empty reply: items carry their own names.
    name = None if items else command.name
    return [Geometry(command.type, items, name, robot.description.model_name)]


def _vehicle_geometry(description: RobotDescription) -> VehicleGeometry:
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


def _find_parts(robot: Robot, type_: str, name: str | None) -> list[Part]:
    return [p for p in robot.find_parts(type_) if name is None or p.name.lower() == name.lower()]
