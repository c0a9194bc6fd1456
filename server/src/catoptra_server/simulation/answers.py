"""What a robot answers to GETCONF and GETGEO. A type or name it lacks has the empty form."""

from __future__ import annotations

from catoptra_protocol.wire.commands import GetConf, GetGeo
from catoptra_protocol.wire.reports import (
    Configuration,
    Geometry,
    GeometryItem,
    MissionPackageGeometry,
    Report,
)
from catoptra_server.sensors import Part
from catoptra_server.simulation.spawned_robot import SpawnedRobot


def configurations(robot: SpawnedRobot, asked: GetConf) -> list[Report]:
    """Return one CONF a part, as UT2004; the robot's own for the type Robot."""
    if _is_robot(asked.type):
        return [robot.own_configuration()]
    parts = _parts(robot, asked.type, asked.name)
    empty = Configuration(asked.type, (("Name", asked.name),) if asked.name else ())
    return [part.configuration() for part in parts] or [empty]


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
