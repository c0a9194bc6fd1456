"""Everything that is read and checked before a thread runs or a socket opens."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.server_file import SERVER_SECTIONS, ServerOptions, read_server_options
from catoptra_server.config.world_file import read_world
from catoptra_server.robot.robot_description import (
    GpsDescription,
    RangeScannerDescription,
    RobotDescription,
    SonarDescription,
    TouchDescription,
    VictimSensorDescription,
)
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from catoptra_server.scene.world_description import World
from catoptra_server.sensors.sensor_environment import RayCaster

log = logging.getLogger(__name__)

# What needs rays all the time. A scene that nothing else measures is committed once it is.
_RAY_CASTING_SENSORS = (
    RangeScannerDescription,
    SonarDescription,
    TouchDescription,
    VictimSensorDescription,
    GpsDescription,
)


@dataclass(frozen=True, slots=True, eq=False)
class StartupConfig:
    """Robots, world and scene, and what the files say of the server itself."""

    robots: tuple[RobotDescription, ...]
    world: World
    scene: SceneMesh
    server_options: ServerOptions = field(default_factory=ServerOptions)


def read_startup_config(
    robots: Sequence[Path], world: Path, server: Path | None = None
) -> StartupConfig:
    """Return what files say: of robots, of the world, and of the server where that has its own.

    Of the server a later robot's file counts more than an earlier one, and its own most. Raises
    ConfigError; keys that mean nothing are logged once.
    """
    read = [read_robots(robot) for robot in robots]
    world_description, world_file = read_world(world)
    robot_files = [file for _, file in read]
    own_files = [_read_server_file(server)] if server is not None else []
    said = ServerOptions()
    for file in (*robot_files, *own_files):
        said.update(read_server_options(file))
    for file in (*robot_files, world_file, *own_files):
        _warn_unknown_keys(file)
    descriptions = tuple(description for found, _ in read for description in found)
    return StartupConfig(descriptions, world_description, build_scene(world_description), said)


def _read_server_file(path: Path) -> IniFile:
    file = IniFile(path)
    if not any(map(file.has_section, SERVER_SECTIONS)):
        log.warning(
            "%s says nothing of the server: no section %s", path, ", ".join(SERVER_SECTIONS)
        )
    return file


def _warn_unknown_keys(file: IniFile) -> None:
    for entry in file.unknown_entries():
        log.warning("%s: key %s is not known here and has no effect", entry.where, entry.key)


def create_ray_caster(startup: StartupConfig) -> RayCaster:
    """Return the scene to be measured, ready if a robot has a sensor that does."""
    caster = _LazyRayCaster(startup.scene)
    sensors = [sensor for robot in startup.robots for sensor in robot.sensors]
    if any(isinstance(sensor, _RAY_CASTING_SENSORS) for sensor in sensors):
        caster.build()
    return caster


class _LazyRayCaster:
    """A ray caster that takes time and memory from its first use on."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._caster: RayCaster | None = None

    def build(self) -> RayCaster:
        """Return the caster, made the first time."""
        if self._caster is None:
            from catoptra_server.render.trace.ray_caster import EmbreeRayCaster

            self._caster = EmbreeRayCaster(self._scene)
        return self._caster

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Return (n,) metres along directions; inf = nothing met."""
        return self.build().distances(origins, directions)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return the distances, and (n, 3) normals of what is met."""
        return self.build().closest_hits(origins, directions)
