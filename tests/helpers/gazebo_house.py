"""A generated house in Gazebo's form, and where each of its meshes must stand.

Walls, doors and furniture: models with a mesh file each, in centimetres, placed by includes that
are relative to frames of rooms, by models within models, and by links and visuals with poses of
their own. The placements are multiplied here by matrices of 4 x 4, from the numbers in the files.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.numerics import Floats

SAE_FROM_SDF = np.diag((1.0, -1.0, -1.0))


def matrix(numbers: str) -> Floats:
    """(4, 4) transform of `x y z roll pitch yaw`, by turns about the fixed axes x, y and z."""
    x, y, z, roll, pitch, yaw = map(float, numbers.split())
    turns = np.eye(3)
    for axis, angle in enumerate((roll, pitch, yaw)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
        turns = turn @ turns
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turns, (x, y, z)
    return result


@dataclass(frozen=True)
class Placement:
    """A mesh in the house."""

    name: str
    """Name of the placed model."""
    vertices: Floats
    """(v, 3) points of the mesh, where they must be in the world, SAE."""


def write_house(
    folder: Path,
    *,
    num_models: int,
    num_placements: int,
    num_segments: int,
    suffix: str = ".obj",
    num_textures: int = 0,
    texture_px: int = 1024,
) -> list[Placement]:
    """Write a house and its models; the placements.

    Args:
        folder: Receives `arena.world` and `models`.
        num_models: Number of models, with a mesh file each.
        num_placements: Number of placed models.
        num_segments: Segments of a mesh: each has 8 triangles.
        suffix: `.obj` or `.dae`, with its unit in the file.
        num_textures: Number of different textures of all models together, of `.dae` alone.
        texture_px: Side of a texture.
    """
    rng = np.random.default_rng(39)
    meshes = []
    for index in range(num_models):
        name = f"part_{index}"
        textures = _write_textures(
            folder / "models" / name, range(index, num_textures, num_models), texture_px
        )
        vertices = _write_mesh(folder / "models" / name, name, rng, num_segments, suffix, textures)
        meshes.append((name, vertices, *_write_model(folder / "models" / name, name, rng, suffix)))
    rooms = [_random_pose(rng) for _ in range(8)]
    lines = [
        f"<frame name='room_{index}' attached_to='{f'room_{index - 1}' if index else 'world'}'>"
        f"<pose>{pose}</pose></frame>"
        for index, pose in enumerate(rooms)
    ]
    world_from_room = [matrix(rooms[0])]
    for pose in rooms[1:]:
        world_from_room.append(world_from_room[-1] @ matrix(pose))
    placements = []
    for index in range(num_placements):
        name, vertices, model_from_mesh, scale = meshes[index % num_models]
        room, pose = index % len(rooms), _random_pose(rng)
        lines.append(
            f"<include><uri>model://{name}</uri><name>placed_{index}</name>"
            f"<pose relative_to='room_{room}'>{pose}</pose></include>"
        )
        world_from_mesh = world_from_room[room] @ matrix(pose) @ model_from_mesh
        points = (vertices * scale) @ world_from_mesh[:3, :3].T + world_from_mesh[:3, 3]
        placements.append(Placement(f"placed_{index}", points @ SAE_FROM_SDF))
    (folder / "arena.world").write_text(
        f"<sdf version='1.9'><world name='house'>{''.join(lines)}</world></sdf>"
    )
    return placements


def _random_pose(rng: np.random.Generator) -> str:
    numbers = (*rng.uniform(-8.0, 8.0, 2), rng.uniform(0.0, 2.0), *rng.uniform(-0.2, 0.2, 2))
    return " ".join(f"{value:.6f}" for value in (*numbers, rng.uniform(-3.1, 3.1)))


def _write_mesh(
    folder: Path,
    name: str,
    rng: np.random.Generator,
    num_segments: int,
    suffix: str,
    textures: list[str],
) -> Floats:
    """Write a rod of boxes in centimetres; its (v, 3) vertices in metres, before any scale."""
    size = rng.uniform(0.2, 2.0, 3)
    sections = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5 * size[:2]
    heights = np.linspace(0.0, size[2], num_segments + 1)
    points = np.array([(x, y, z) for z in heights for x, y in sections])
    faces = [
        (4 * row + a, 4 * row + (a + 1) % 4, 4 * row + 4 + b)
        for row in range(num_segments)
        for a in range(4)
        for b in (a, (a + 1) % 4)
    ]
    (folder / "meshes").mkdir(parents=True)
    path = folder / "meshes" / f"{name}{suffix}"
    centimetres = np.round(100.0 * points, 4)
    if suffix == ".obj":
        text = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in centimetres]
        text += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        path.write_text("\n".join(text))
    else:
        path.write_text(_format_collada(centimetres, faces, textures))
    return centimetres / 100.0


def _write_textures(folder: Path, seeds: range, side_px: int) -> list[str]:
    """Write pictures of tiles under noise, which no file format makes small; their names."""
    (folder / "materials" / "textures").mkdir(parents=True)
    names = [f"paint_{seed}.png" for seed in seeds]
    for name, seed in zip(names, seeds, strict=True):
        rng = np.random.default_rng(seed)
        tiles = rng.integers(40, 200, (8, 8, 3)).repeat(side_px // 8, axis=0)
        noise = rng.integers(0, 24, (side_px, side_px, 3))
        image = Image.fromarray((tiles.repeat(side_px // 8, axis=1) + noise).astype(np.uint8))
        image.save(folder / "materials" / "textures" / name, compress_level=3)
    return names


def _format_collada(points: Floats, faces: list[tuple[int, int, int]], textures: list[str]) -> str:
    """A COLLADA file whose faces have one texture after the other."""
    positions = " ".join(f"{value:.4f}" for value in points.ravel())
    parts = [faces[number :: len(textures)] for number in range(len(textures))] or [faces]
    triangles, images, effects, materials, bound = "", "", "", "", ""
    for number, part in enumerate(parts):
        corners = " ".join(f"{at} {corner}" for face in part for corner, at in enumerate(face))
        triangles += f"""<triangles count="{len(part)}" material="s{number}">
<input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><p>{corners}</p></triangles>"""
    for number, name in enumerate(textures):
        images += f"""<image id="i{number}"><init_from>{name}</init_from></image>"""
        effects += f"""<effect id="e{number}"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i{number}</init_from></surface></newparam>
<newparam sid="p"><sampler2D><source>f</source></sampler2D></newparam><technique sid="t"><lambert>
<diffuse><texture texture="p" texcoord="UV"/></diffuse></lambert></technique></profile_COMMON>
</effect>"""
        materials += f"""<material id="m{number}"><instance_effect url="#e{number}"/></material>"""
        bound += f"""<instance_material symbol="s{number}" target="#m{number}"/>"""
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_images>{images}</library_images><library_effects>{effects}</library_effects>
<library_materials>{materials}</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="{points.size}">{positions}</float_array>
<technique_common><accessor source="#a" count="{len(points)}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<source id="t"><float_array id="b" count="6">0 0 1 0 1 1</float_array><technique_common>
<accessor source="#b" count="3" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{triangles}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material>
<technique_common>{bound}</technique_common></bind_material></instance_geometry></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def _write_model(
    folder: Path, name: str, rng: np.random.Generator, suffix: str
) -> tuple[Floats, Floats]:
    """Write a model of its mesh, in a model of its own; model_from_mesh, and the scale."""
    outer, link, visual = (_random_pose(rng) for _ in range(3))
    factors = rng.choice((-1.0, 1.0), 3) * rng.uniform(0.5, 1.5, 3).round(3)
    # COLLADA states its unit; OBJ has none.
    scale = factors * (0.01 if suffix == ".obj" else 1.0)
    text = " ".join(f"{value:.6g}" for value in scale)
    (folder / "model.config").write_text(
        f"<model><name>{name}</name><sdf version='1.4'>old.sdf</sdf>"
        "<sdf version='1.10'>model.sdf</sdf></model>"
    )
    (folder / "model.sdf").write_text(
        f"<sdf version='1.10'><model name='{name}'><model name='inner'><pose>{outer}</pose>"
        f"<link name='body'><pose>{link}</pose><visual name='look'><pose>{visual}</pose>"
        f"<geometry><mesh><uri>model://{name}/meshes/{name}{suffix}</uri><scale>{text}</scale>"
        "</mesh></geometry></visual></link></model></model></sdf>"
    )
    return matrix(outer) @ matrix(link) @ matrix(visual), factors
