"""Scenes of the comparison of ray tracers, each made by a fixed script.

The soccer field, 60 000 triangles of clutter, a bumpy hall of a million triangles in one mesh file,
and a room of five textured walls. No light varies over a triangle and nothing casts a shadow, so
that a table of one colour a triangle shades everything but the textures. Files go to a folder of
the caller's.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.scene.world_description import (
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
# Half the floor's side and the height of hall and textured room, metres.
HALL_HALF_M, HALL_HEIGHT_M = 6.0, 2.5
ROOM_HALF_M, ROOM_HEIGHT_M = 3.0, 2.5
# Quads along both sides of each surface: 500 000 + 180 000 + 4 x 80 000 triangles.
FLOOR_QUADS, CEILING_QUADS, WALL_QUADS = (500, 500), (300, 300), (400, 100)
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
    """The four worlds; their mesh and texture files are written into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    return {
        "field": read_world(FIELD)[0],
        "clutter": make_balls(),
        "million": make_million(folder / "hall.ply"),
        "textured": make_textured_room(folder),
    }


def make_million(path: Path) -> World:
    """A closed hall of a million triangles around the viewpoint, bumpy on all sides."""
    write_ply(path, *make_hall(np.random.default_rng(7)))
    hall = Item("hall", MeshFile(path, up="z"), Pose.identity(), Material((0.6, 0.55, 0.5)))
    return World("million", (hall,), lights=_LIGHTS, background=_SKY)


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


def make_hall(rng: np.random.Generator) -> Surface:
    """Vertices of six bumpy surfaces that meet at flat edges, and their million triangles.

    The file's frame: z up, floor at z = 0. Each surface has a corner, two sides and the direction
    of its bumps, into the hall.
    """
    half, top = HALL_HALF_M, HALL_HEIGHT_M
    along_x, along_y, up = 2.0 * half * np.eye(3)[0], 2.0 * half * np.eye(3)[1], top * np.eye(3)[2]
    low = np.array([-half, -half, 0.0])
    surfaces = [
        make_bumpy_surface(rng, low, along_x, along_y, FLOOR_QUADS),
        make_bumpy_surface(rng, low + up, along_y, along_x, CEILING_QUADS),
        make_bumpy_surface(rng, low, up, along_x, WALL_QUADS[::-1]),
        make_bumpy_surface(rng, low + along_y, along_x, up, WALL_QUADS),
        make_bumpy_surface(rng, low, along_y, up, WALL_QUADS),
        make_bumpy_surface(rng, low + along_x, up, along_y, WALL_QUADS[::-1]),
    ]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    vertices = np.concatenate([vertices for vertices, _ in surfaces])
    faces = [faces + start for (_, faces), start in zip(surfaces, starts[:-1], strict=True)]
    return vertices, np.concatenate(faces)


def make_bumpy_surface(
    rng: np.random.Generator, corner: Floats, a: Floats, b: Floats, quads: tuple[int, int]
) -> Surface:
    """Parallelogram of sides a and b, raised along a x b by waves that vanish at its edges."""
    columns, rows = quads
    s, t = np.meshgrid(
        np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1), indexing="ij"
    )
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    lengths = np.linalg.norm(a), np.linalg.norm(b)
    height = bump_heights(rng, s * lengths[0], t * lengths[1])
    height *= np.minimum(1.0, 8.0 * np.minimum(s * (1.0 - s), t * (1.0 - t)))
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
    return MAX_BUMP_M * (total - total.min()) / np.ptp(total)


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
