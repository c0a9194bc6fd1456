"""A mesh file as a world: its unit, axes, extent and floor, light, and a start on free floor.

Robots drive on the plane z = 0. The floor is the lowest height at which a share of the level area
lies, or the lowest point of a mesh that has no room for a robot; the mesh is moved to have it
there.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import format_start
from catoptra_server.simulation.floor_plan import find_start
from catoptra_server.world.mesh_files import load_mesh_lights
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Item, MeshFile, World

log = logging.getLogger(__name__)

# Heights of level areas are counted in steps; of the largest area a share is a floor. A table or a
# step has less, a storey more.
_STEP_M, _FLOOR_SHARE = 0.02, 0.3
_LEVEL_COSINE = 0.95
# Files of other units: a house in centimetres, a desk in millimetres.
_MAX_EXTENT_M, _MIN_EXTENT_M = 500.0, 1.0
# Light of an overcast day and a sun: white walls stay below white.
_LIGHTS = """\
Lights=(Type=Hemisphere,Up=(R=205,G=208,B=212),Down=(R=150,G=146,B=140))
Lights=(Type=Directional,Direction=(X=0.35,Y=0.3,Z=0.89),Colour=(R=255,G=246,B=230),Brightness=0.4)"""


def describe_mesh_world(path: Path) -> str:
    """Text of a world file with a mesh file alone; what was found is logged, too.

    Raises:
        ConfigError: The file is missing, unreadable, too large or without a triangle.
    """
    if set('"\r\n') & set(path.name):
        where = SourceLocation(str(path))
        expected = "a name without quotation marks and line ends"
        raise ConfigError(where, key="file", value=path.name, expected=expected)
    up = "y" if path.suffix.lower() in (".glb", ".gltf") else ""
    shape = MeshFile(path, up=up) if up else MeshFile(path)
    # The server builds the world once more: images take most of the time, and say nothing here.
    world = World(path.name, (Item(path.stem, shape, Pose.identity(), None),))
    scene = build_scene(world, has_texels=False)
    floor_z = _find_floor(scene)
    start = find_start(_raise_scene(scene, floor_z))
    if start is None:
        # No room, but a thing: a robot stands beside it.
        lowest_z = round(float(scene.box_max[2]), 3)
        start = find_start(_raise_scene(scene, lowest_z))
        floor_z = floor_z if start is None else lowest_z
    notes = _describe(path, shape, scene, floor_z, start)
    for note in notes:
        log.info("%s: %s", path, note)
    name = path.stem.translate(str.maketrans("{}", "__"))
    member = up and f",Up={up}"
    lines = [f'Name="{name}"', "Background=(R=175,G=195,B=215)"]
    lines += [] if load_mesh_lights(shape) else [_LIGHTS]
    lines.append(f'Meshes=(Name="{name}",File="{path.name}"{member},Position=(Z={-floor_z!r}))')
    if start is not None:
        lines.append(format_start(*start))
    return "\n".join((*(f"; {note}" for note in notes), "[Catoptra.World]", *lines, ""))


def _raise_scene(scene: SceneMesh, floor_z: float) -> SceneMesh:
    return replace(scene, corners=scene.corners - (0.0, 0.0, floor_z))


def _find_floor(scene: SceneMesh) -> float:
    """z of the floor; of the lowest point, where nothing is level."""
    edges = scene.corners[:, 1:] - scene.corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    level = scene.normals[:, 2] < -_LEVEL_COSINE
    if not level.any():  # wound the wrong way round
        level = scene.normals[:, 2] > _LEVEL_COSINE
    z, areas = scene.corners[level].mean(axis=1)[:, 2], areas[level]
    if not len(z):
        return round(float(scene.box_max[2]), 3)
    steps = np.round((scene.box_max[2] - z) / _STEP_M).astype(np.intp)
    _, index = np.unique(steps, return_inverse=True)
    area = np.bincount(index, areas)
    lowest = int(np.argmax(area >= _FLOOR_SHARE * area.max()))
    return round(float(np.average(z[index == lowest], weights=areas[index == lowest])), 3)


def _describe(
    path: Path,
    shape: MeshFile,
    scene: SceneMesh,
    floor_z: float,
    start: tuple[float, float] | None,
) -> list[str]:
    """Sentences about what was found and chosen."""
    extent = scene.box_max - scene.box_min
    x, y, z = extent.tolist()
    axes = {"y": "y up", "z": "z up"}.get(shape.up, "axes of the file")
    notes = [
        f"{path.name} as a world: in metres, {axes}; {x:.2f} x {y:.2f} m, {z:.2f} m high",
        f"the floor is at {0.0 - floor_z:g} m of the file's height; light of a day is added",
    ]
    if not _MIN_EXTENT_M <= max(extent) <= _MAX_EXTENT_M:
        notes.append("is it in metres? a world file has Meshes=(File=...,Scale=0.01) for others")
    place = "no free floor for a start: give a Location" if start is None else ""
    notes.append(place or "the start is Start, at {:g}, {:g}".format(*start or ()))
    return notes
