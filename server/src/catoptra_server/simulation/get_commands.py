"""What a robot answers to GETCONF and GETGEO. A type or name it lacks has the empty form."""

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
)
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.frames.frame_request import OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.sensors import Part
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.robot import Robot

ErrorBoundLookup = Callable[[OmniCameraSpec], ErrorBound | None]


def execute_get_conf(
    robot: Robot, command: GetConf, error_bound_of: ErrorBoundLookup = lambda eye: None
) -> list[Report]:
    """Return one CONF a part, as UT2004; the robot's own for the type Robot.

    error_bound_of: how far off what is seen through an eye may be; None while it is not drawn.
    """
    if _is_robot(command.type):
        return [robot.vehicle_configuration()]
    parts = _find_parts(robot, command.type, command.name)
    empty = Configuration(command.type, (("Name", command.name),) if command.name else ())
    return [_configuration(part, error_bound_of) for part in parts] or [empty]


def _configuration(part: Part, error_bound_of: ErrorBoundLookup) -> Report:
    """Return a part's CONF; a camera whose bound is known tells it, too."""
    said = part.configuration()
    bound = (
        error_bound_of(part.camera_spec(part.tile)) if isinstance(part, OmniCameraSensor) else None
    )
    if bound is None or not isinstance(said, CameraConfiguration):
        return said
    pairs = (
        ("ErrorBoundPx", format_fixed_point(bound.outline_error_px, 6)),
        ("ErrorRmsPx", format_fixed_point(bound.geometric.rms_px, 6)),
    )
    return dataclasses.replace(said, extra_pairs=(*said.extra_pairs, *pairs))


def execute_get_geo(robot: Robot, command: GetGeo) -> list[Report]:
    """Return one GEO with all parts of a type; of mission packages one each."""
    if _is_robot(command.type):
        return [robot.vehicle_geometry()]
    found = [part.geometry() for part in _find_parts(robot, command.type, command.name)]
    packages = [one for one in found if isinstance(one, MissionPackageGeometry)]
    items = tuple(one for one in found if isinstance(one, GeometryItem))
    if packages and not items:
        return [*packages]
    return [Geometry(command.type, items, name=None if items else command.name)]


def _is_robot(type_: str) -> bool:
    """Return whether the robot itself is meant: by its model's name, whatever name is asked for."""
    return type_.lower() == "robot"


def _find_parts(robot: Robot, type_: str, name: str | None) -> list[Part]:
    return [p for p in robot.find_parts(type_) if name is None or p.name.lower() == name.lower()]
