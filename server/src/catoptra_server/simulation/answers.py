"""What a robot answers to GETCONF and GETGEO. A type or name it lacks has the empty form."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from catoptra_protocol.wire.commands import GetConf, GetGeo
from catoptra_protocol.wire.numbers import fixed
from catoptra_protocol.wire.reports import (
    CameraConfiguration,
    Configuration,
    Geometry,
    GeometryItem,
    MissionPackageGeometry,
    Report,
)
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.plan.error_bound import ErrorBound
from catoptra_server.sensors import Part
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.spawned_robot import SpawnedRobot

BoundOf = Callable[[OmniEye], ErrorBound | None]


def configurations(
    robot: SpawnedRobot, asked: GetConf, bound_of: BoundOf = lambda eye: None
) -> list[Report]:
    """Return one CONF a part, as UT2004; the robot's own for the type Robot.

    bound_of: how far off what is seen through an eye may be; None while it is not drawn.
    """
    if _is_robot(asked.type):
        return [robot.own_configuration()]
    parts = _parts(robot, asked.type, asked.name)
    empty = Configuration(asked.type, (("Name", asked.name),) if asked.name else ())
    return [_configuration(part, bound_of) for part in parts] or [empty]


def _configuration(part: Part, bound_of: BoundOf) -> Report:
    """Return a part's CONF; a camera whose bound is known tells it, too."""
    said = part.configuration()
    bound = bound_of(part.eye(part.tile)) if isinstance(part, OmniCameraSensor) else None
    if bound is None or not isinstance(said, CameraConfiguration):
        return said
    pairs = (
        ("ErrorBoundPx", fixed(bound.outline_px, 6)),
        ("ErrorRmsPx", fixed(bound.geometric.rms_px, 6)),
    )
    return dataclasses.replace(said, others=(*said.others, *pairs))


def geometries(robot: SpawnedRobot, asked: GetGeo) -> list[Report]:
    """Return one GEO with all parts of a type; of mission packages one each."""
    if _is_robot(asked.type):
        return [robot.own_geometry()]
    found = [part.geometry() for part in _parts(robot, asked.type, asked.name)]
    packages = [one for one in found if isinstance(one, MissionPackageGeometry)]
    items = tuple(one for one in found if isinstance(one, GeometryItem))
    if packages and not items:
        return [*packages]
    return [Geometry(asked.type, items, name=None if items else asked.name)]


def _is_robot(type_: str) -> bool:
    """Return whether the robot itself is meant: by its model's name, whatever name is asked for."""
    return type_.lower() == "robot"


def _parts(robot: SpawnedRobot, type_: str, name: str | None) -> list[Part]:
    return [p for p in robot.parts(type_) if name is None or p.name.lower() == name.lower()]
