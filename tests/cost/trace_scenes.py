"""Scenes of the comparison of ray tracers, each made by a fixed script.

The soccer field, 60 000 triangles of clutter, bumpy ground of a million triangles in one mesh file,
and a room of five textured walls. No light varies over a triangle and nothing casts a shadow, so
that a table of one colour a triangle shades everything but the textures.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Item,
    Material,
    MeshFile,
    Rectangle,
    World,
)
from measurements.scenes import FIELD, make_balls

TEXTURE_SIZE_PX = 512
# Half the floor's side and the height of the textured room, metres.
ROOM_HALF_M, ROOM_HEIGHT_M = 3.0, 2.5
# 800 x 625 quads are a million triangles, 2.5 cm each. The size sets how many of them a pixel sees:
# here bare packets trace 2.4 to 3 times as slowly as on the field, as in the comparison with other
# renderers that the required factors come from.
TERRAIN_QUADS, TERRAIN_SIZE_M = (800, 625), (20.0, 16.0)
# The ground rises beyond this radius, so that distant parts are in view.
HOLLOW_RADIUS_M, HOLLOW_SLOPE = 2.5, 0.15
# Highest bump, below the cameras at 0.6 m.
MAX_BUMP_M = 0.25
WAVES = 24
_SKY = (0.3, 0.3, 0.35)
# Oblique, so that the facets of a bumpy surface differ in colour.
_LIGHTS = (
    HemisphereLight((0.4, 0.4, 0.4), (0.3, 0.3, 0.3)),
    DirectionalLight((0.64, 0.48, 0.6), (0.6, 0.6, 0.55)),
)

Surface = tuple[Floats, Floats]  # (v, 3) vertices, (t, 3) indices


def make_trace_worlds(folder: Path) -> dict[str, World]:
    """The four worlds; mesh and texture files are written into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    return {
        "field": read_world(FIELD)[0],
        "clutter": make_balls(),
        "million": make_million(folder / "ground.ply"),
        "textured": make_textured_room(folder),
    }


def make_million(path: Path) -> World:
    """Bumpy ground of a million triangles around the viewpoint, in one mesh."""
    write_ply(path, *make_terrain(np.random.default_rng(7)))
    ground = Item("ground", MeshFile(path, up="z"), Pose.identity(), Material((0.6, 0.55, 0.5)))
    return World("million", (ground,), lights=_LIGHTS, background=_SKY)


def write_million_world(folder: Path) -> Path:
    """World file of the same ground, below the wheels of robots, for a server."""
    write_ply(folder / "ground.ply", *make_terrain(np.random.default_rng(7)))
    path = folder / "million.ini"
    path.write_text(
        "[Catoptra.World]\nName=Million\n"
        "Lights=(Type=Hemisphere,Up=(R=170,G=170,B=170),Down=(R=149,G=149,B=149))\n"
        "Lights=(Type=Directional,Direction=(X=0.64,Y=0.48,Z=0.6),Brightness=0.6)\n"
        f'Meshes=(Name="ground",File="ground.ply",Position=(X=0,Y=0,Z={MAX_BUMP_M}),Up=z,'
        "Colour=(R=203,G=196,B=188))\n",
        encoding="utf-8",
    )
    return path


def make_textured_room(folder: Path) -> World:
    """A floor and four walls without lights, each with a texture of its own."""
    rng = np.random.default_rng(11)
    items = []
    for name, shape, pose in _room_rectangles():
        path = folder / f"{name}.png"
        Image.fromarray(make_texture(rng)).save(path)
        items.append(Item(name, shape, pose, Material((1.0, 1.0, 1.0), texture=path, unlit=True)))
    return World("textured", tuple(items), background=_SKY)


def make_texture(rng: np.random.Generator) -> np.ndarray[tuple[int, int, int]]:
    """(512, 512, 3) uint8: tiles of random colours under noise, so that every texel differs."""
    tiles = rng.integers(40, 200, size=(8, 8, 3)).repeat(TEXTURE_SIZE_PX // 8, axis=0)
    noise = rng.integers(0, 50, size=(TEXTURE_SIZE_PX, TEXTURE_SIZE_PX, 3))
    return (tiles.repeat(TEXTURE_SIZE_PX // 8, axis=1) + noise).astype(np.uint8)


def _room_rectangles() -> list[tuple[str, Rectangle, Pose]]:
    """Names, shapes and poses of floor and walls; each faces inwards."""
    side, height = 2.0 * ROOM_HALF_M, ROOM_HEIGHT_M
    surfaces = [("floor", Rectangle((side, side), (3.0, 3.0)), Pose.identity())]
    for index in range(4):
        yaw = 0.5 * math.pi * index
        location_m = (ROOM_HALF_M * math.cos(yaw), ROOM_HALF_M * math.sin(yaw), -0.5 * height)
        # Pitched up by 90 degrees, a level rectangle faces back along its own heading.
        pose = Pose.from_rpy(location_m, (0.0, 0.5 * math.pi, yaw))
        surfaces.append((f"wall{index}", Rectangle((height, side), (3.0, 1.0)), pose))
    return surfaces


def make_terrain(rng: np.random.Generator) -> Surface:
    """Vertices and the million triangles of a hollow; the file's frame: z up, the floor near 0."""
    size_x, size_y = TERRAIN_SIZE_M
    corner = np.array([-0.5 * size_x, -0.5 * size_y, 0.0])
    sides = np.array([size_x, 0.0, 0.0]), np.array([0.0, size_y, 0.0])
    vertices, faces = make_bumpy_surface(rng, corner, *sides, TERRAIN_QUADS)
    distance = np.hypot(vertices[:, 0], vertices[:, 1])
    vertices[:, 2] += HOLLOW_SLOPE * np.maximum(distance - HOLLOW_RADIUS_M, 0.0)
    return vertices, faces


def make_bumpy_surface(
    rng: np.random.Generator, corner: Floats, a: Floats, b: Floats, quads: tuple[int, int]
) -> Surface:
    """Parallelogram of sides a and b, raised along a x b by waves."""
    columns, rows = quads
    s, t = np.meshgrid(
        np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1), indexing="ij"
    )
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    lengths = np.linalg.norm(a), np.linalg.norm(b)
    height = bump_heights(rng, s * lengths[0], t * lengths[1])
    points = corner + s[..., None] * a + t[..., None] * b + height[..., None] * normal
    first = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).reshape(-1)
    next_column, next_row = first + rows + 1, first + 1
    faces = np.stack(
        [first, next_column, next_column + 1, first, next_column + 1, next_row], axis=-1
    )
    return points.reshape(-1, 3), faces.reshape(-1, 3)


def bump_heights(rng: np.random.Generator, x: Floats, y: Floats) -> Floats:
    """Heights of 0 to MAX_BUMP_M at positions in metres: waves of 0.2 to 2 m."""
    total = np.zeros_like(x)
    for _ in range(WAVES):
        length = 0.2 * 10.0 ** rng.uniform()
        bearing, phase = rng.uniform(0.0, 2.0 * math.pi, 2)
        along = math.cos(bearing) * x + math.sin(bearing) * y
        total += length * np.sin(2.0 * math.pi * along / length + phase)
    heights: Floats = MAX_BUMP_M * (total - total.min()) / np.ptp(total)
    return heights


def write_ply(path: Path, vertices: Floats, faces: Floats) -> None:
    """Write a binary PLY of (v, 3) vertices and (t, 3) triangles."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    body = vertices.astype("<f4").tobytes() + rows.tobytes()
    path.write_bytes(header.encode("ascii") + body)
