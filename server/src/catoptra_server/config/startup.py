"""All configuration files of a server, read and checked before a thread runs or a socket opens.

Unknown names are reported after the last reader.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property, reduce
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import report_unknown_names
from catoptra_server.config.robot_file import find_unserved_robots, read_robots
from catoptra_server.config.server_file import SERVER_SECTIONS, ServerOptions, read_server_options
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import EffectSettings, name_effect
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    PerspectiveCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.simulation.sensors import RayCaster, Triangles, casts_rays
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World

if TYPE_CHECKING:
    from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
    from catoptra_server.render.trace.occlusion.occlusion_cache import LitWorld
    from catoptra_server.render.trace.ray_caster import SceneRayCaster

log = logging.getLogger(__name__)

_CameraT = TypeVar("_CameraT", OmniCameraDescription, PerspectiveCameraDescription)


@dataclass(frozen=True, slots=True, eq=False)
class StartupConfig:
    """Content of the configuration files."""

    robots: tuple[RobotDescription, ...]
    """All robots, in the order of the files."""
    world: World
    """The world as described."""
    scene: SceneMesh
    """The world's triangles, meshes and textures loaded."""
    server_options: ServerOptions = field(default_factory=ServerOptions)
    """Options that the files state for the server itself."""
    light: LitWorld | None = None
    """How the scene's light was computed, and what is left to do; None for a world without."""

    def with_light(self, light: LitWorld) -> StartupConfig:
        """The same with other light."""
        return replace(self, scene=light.scene, world=light.world, light=light)

    def name_world_effects(self) -> StartupConfig:
        """The same with rows for what the world's light adds to the pictures of all cameras."""
        names = ["BakedLight"] * self.world.light_bake + ["SkyRadiance"] * (
            self.world.sky is not None
        )
        return replace(self, robots=tuple(_name_effects(robot, names) for robot in self.robots))

    @property
    def effect_settings(self) -> tuple[EffectSettings, ...]:
        """Effects of all cameras."""
        of_omnis = [one.effects for robot in self.robots for one in robot.omni_cameras]
        of_lenses = [one.effects for robot in self.robots for one in robot.perspective_cameras]
        return (*of_omnis, *of_lenses)


def read_startup_config(
    robots: Sequence[Path],
    world: Path,
    server: Path | None = None,
    *,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
    is_strict: bool = False,
    has_first_light: bool = False,
) -> StartupConfig:
    """Read all configuration files, and log their unknown keys.

    Args:
        robots: robot files; of the server's options a later file overrides an earlier one.
        world: the world file.
        server: file with the server's own sections, which overrides robot files.
        limit_bytes: memory that each camera's view may take, and the scene as a whole.
        is_strict: reject unknown keys of USARSim's sections, too, not of our own alone.
        has_first_light: leave most rays of a light bake to `StartupConfig.light`.

    Raises:
        ConfigError: with file, line, key, value and the expected form.
    """
    contents = [read_robots(robot, limit_bytes=limit_bytes) for robot in robots]
    world_description, world_file = read_world(world)
    robot_files = [file for _, file in contents]
    server_files = [_read_server_file(server)] if server is not None else []
    options = ServerOptions()
    for file in (*robot_files, *server_files):
        options.update(read_server_options(file))
    # After every reader: only now all known keys have been read.
    for file in (*robot_files, world_file, *server_files):
        report_unknown_names(file.unknown_names(), is_strict=is_strict)
    for file in robot_files:
        _warn_unserved_robots(file)
    descriptions = _drop_repeated_classes([one for robot, _ in contents for one in robot])
    scene = build_scene(world_description, MemoryBudget(limit_bytes))
    startup = StartupConfig(descriptions, world_description, scene, options).name_world_effects()
    if not (world_description.ambient_occlusion or world_description.light_bake):
        return startup
    # Loaded where it is needed: see `commands/server.py`.
    from catoptra_server.render.trace.occlusion.occlusion_cache import begin_light

    light = begin_light(scene, world_description)
    if light.refine is not None and not has_first_light:
        light = light.refine(lambda: False)
    return startup.with_light(light)


# Start poses at which candidate plans are timed; their frames stand for all frames of the world.
_MAX_START_STATES = 4


def make_start_states(startup: StartupConfig) -> tuple[CameraState, ...]:
    """Camera states to choose plans for: upright at the world's start poses, or at the origin.

    The height of the first robot with an omnidirectional camera.
    """
    heights_m = [r.viewpoint_height_m(omni) for r in startup.robots for omni in r.omni_cameras]
    height_m = next(iter(heights_m), 0.0)
    starts = [(s.location_m, s.rotation_rad) for s in startup.world.starts[:_MAX_START_STATES]]
    return tuple(
        mounted_camera_state(PlanarPose(x, y, yaw).at_height(height_m), Pose.identity())
        for (x, y, _), (_, _, yaw) in starts or [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    )


def create_ray_caster(startup: StartupConfig) -> RayCaster:
    """Ray caster for sensors, built now if a robot has a sensor that casts rays in every cycle.

    Otherwise at the first ray, if ever: a server with cameras alone saves the time and memory.
    """
    caster = _LazyRayCaster(startup.scene)
    if any(casts_rays(sensor) for robot in startup.robots for sensor in robot.sensors):
        return caster.built
    return caster


def _name_effects(robot: RobotDescription, names: Sequence[str]) -> RobotDescription:
    """Robot whose cameras name some effects."""

    def name_all(camera: _CameraT) -> _CameraT:
        return replace(camera, effects=reduce(name_effect, names, camera.effects))

    if not names:
        return robot
    return replace(
        robot,
        omni_cameras=tuple(map(name_all, robot.omni_cameras)),
        perspective_cameras=tuple(map(name_all, robot.perspective_cameras)),
    )


def _read_server_file(path: Path) -> IniFile:
    file = IniFile(path)
    if not any(map(file.has_section, SERVER_SECTIONS)):
        log.warning(
            "%s has no settings of the server: no section %s", path, ", ".join(SERVER_SECTIONS)
        )
    return file


def _warn_unserved_robots(file: IniFile) -> None:
    names = find_unserved_robots(file)
    if names:
        log.warning(
            "%s: not served: %s; a robot has SteeringType=SkidSteered, or the name of a class of "
            "USARSim with four wheels or two",
            file.path,
            ", ".join(names),
        )


def _drop_repeated_classes(
    descriptions: Sequence[RobotDescription],
) -> tuple[RobotDescription, ...]:
    """Robots of different classes; of several with the name of one class the first."""
    first: dict[str, RobotDescription] = {}
    for description in descriptions:
        known = first.setdefault(description.class_name.lower(), description)
        if known is not description:
            log.warning(
                "a second robot of class %s is left out: INIT finds the first one of a name; "
                "rename the section of one of them",
                description.class_name,
            )
    return tuple(first.values())


class _LazyRayCaster:
    """A ray caster that is built at the first use."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene

    @cached_property
    def built(self) -> SceneRayCaster:
        """The ray caster, built at the first use."""
        # Loaded where it is needed: see `commands/server.py`.
        from catoptra_server.render.trace.ray_caster import commit_ray_caster

        return commit_ray_caster(self._scene)

    @property
    def kernel(self) -> KernelMeshCaster | None:
        """The native one, if it can run."""
        return self.built.kernel

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Distances (n,) along unit directions, metres; inf without a hit."""
        return self.built.distances(origins, directions)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances (n,), metres, and normals (n, 3) of the closest hits."""
        return self.built.closest_hits(origins, directions)

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Distances (n,), metres, and indices (n,) of the closest triangles; else inf and -1."""
        return self.built.closest_triangles(origins, directions)
