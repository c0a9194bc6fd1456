"""Light: the sRGB curve, sums of samples, point lights, closed rooms, boxes, the sun."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.occlusion.light_bake import bake_light
from catoptra_server.render.trace.occlusion.occlusion_cache import NodeLight
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.render.trace.reference import reference_engine as ray_batches
from catoptra_server.world import shading
from catoptra_server.world import world_description as colour
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.sky import SkyDescription, compute_sunlight
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    PointLight,
    RectangleLight,
    World,
)


def _encode(linear: float) -> Floats:
    return colour.srgb_from_linear(np.array(linear))


def _greys(red: list[float], samples: int) -> list[int]:
    """Greys of a pixel: red cycles through the list, green is full, blue dark."""
    side = math.isqrt(samples)
    pixel = np.zeros((samples, 3))
    pixel[:, 0], pixel[:, 1] = np.resize(np.array(red), samples), 1.0
    # Sixteen pixels of the same samples, in blocks of 4 x 4 rays.
    grid = np.tile(pixel.reshape(side, side, 3), (4, 4, 1))
    blocks = grid.reshape(side, 4, side, 4, 3).swapaxes(1, 2).reshape(1, samples, 16, 3)
    return [int(level) for level in ray_batches.encode_pixels(blocks, side)[0, 0, 0]]


def _irradiance(height_m: float) -> float:
    lamp = PointLight((0.0, 0.0, -height_m), (1.0, 1.0, 1.0))
    floor, up = np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]])
    return float(shading.point_irradiance((lamp,), floor, up)[0, 0])


def _bake_furnace(albedo: float) -> tuple[SceneMesh, NodeLight]:
    """Baked light of a closed room that emits the radiance 1."""
    material, walls = Material((albedo,) * 3), ((0.0, -2.2), (0.0, 0.2), (-1.2, -1.0), (1.2, -1.0))
    items = [
        Item(
            f"{x} {z}",
            Box((2.0, 2.0, 0.4) if x == 0.0 else (0.4, 2.0, 2.0)),
            Pose.from_rpy((x, 0.0, z)),
            material,
        )
        for x, z in walls
    ]
    items += [
        Item(f"end {y}", Box((2.8, 0.4, 2.8)), Pose.from_rpy((0.0, y, -1.0)), material)
        for y in (-1.2, 1.2)
    ]
    world = World("furnace", tuple(items))
    scene = build_scene(world)
    scene = replace(scene, emission=np.ones((len(scene), 3)))
    return scene, bake_light(scene, world, 2, threads=1)


def _probe(albedo: float) -> float:
    """Irradiance of an object's side in the middle of the same room."""
    _, light = _bake_furnace(albedo)
    return float(light.probes.find_light(np.array([0.0, 0.0, -1.0])).faces[2, 0])


def _beyond_stated(distance_m: float, half_x_m: float, half_y_m: float) -> float:
    """Share of nodes below a rectangle whose light is off by more than the stated error."""
    size = (2.0 * half_x_m, 2.0 * half_y_m)
    lamp = RectangleLight((0.0, 0.0, -distance_m), (0.0, 0.0, 1.0), size, (1.0, 1.0, 1.0))
    floor = Item(
        "floor", Box((3.0, 3.0, 0.2)), Pose.from_rpy((0.0, 0.0, 0.1)), Material((0.5,) * 3)
    )
    world = World("floor", (floor,), area_lights=(lamp,))
    scene = build_scene(world)
    light = bake_light(scene, world, 16, threads=1)
    grid = light.occlusion.patch_of[np.flatnonzero(scene.normals[:, 2] < -0.5)[0]]
    left, top, right, bottom = light.occlusion.bounds[grid].tolist()
    # Without the outermost, which stand within the border.
    row, column = (one.reshape(-1) for one in np.mgrid[top + 1 : bottom, left + 1 : right])
    rows = np.stack(
        (light.occlusion.columns_from_world[grid], light.occlusion.rows_from_world[grid])
    )
    places = np.linalg.solve(rows[:, :2], np.stack((column, row)) - rows[:, 3:])
    # Nodes stand 3 mm before their surface.
    points = np.column_stack((places.T, np.full(len(column), distance_m - 0.003)))
    thin = np.array([half_x_m, half_y_m, 1e-9])
    factors = shading.box_form_factors(points, np.tile([0.0, 0.0, -1.0], (len(points), 1)), thin)
    exact = math.pi * factors / (size[0] * size[1])
    difference = np.abs(light.light[row, column, 0] - exact)
    return float((difference > light.error[row, column, 0]).mean())


def _furnace(albedo: float) -> float:
    """Irradiance in the middle of the floor of the same room."""
    scene, light = _bake_furnace(albedo)
    up, at = np.array([[0.0, 0.0, 1.0]]), np.array([[0.1, 0.2, -1.0]])
    distances, triangles = commit_ray_caster(scene).closest_triangles(at, up)
    factors = light.occlusion.factors(triangles, at + distances[:, None] * up)
    return float(light.brightest[0] * factors[0, 0])


def _box_beside(distance_m: float, half_width_m: float, height_m: float, below_m: float) -> float:
    """Form factor of a box before a point that faces up."""
    half = np.array([0.2, half_width_m, 0.5 * (height_m + below_m)])
    place = np.array([[-half[0] - distance_m, 0.0, half[2] - below_m]])
    return float(shading.box_form_factors(place, np.array([[0.0, 0.0, -1.0]]), half)[0])


def _box_above(distance_m: float, half_x_m: float, half_y_m: float) -> float:
    """Form factor of a box over a point that faces up."""
    half = np.array([half_x_m, half_y_m, 0.15])
    place, up = np.array([[0.0, 0.0, 0.15 + distance_m]]), np.array([[0.0, 0.0, -1.0]])
    return float(shading.box_form_factors(place, up, half)[0])


def _sunlight(elevation_deg: float, turbidity: float) -> Floats:
    """(3,) irradiance of a sky's sun."""
    return compute_sunlight(SkyDescription(math.radians(elevation_deg), 0.0, turbidity))


SUBJECTS = {
    "sunlight": _sunlight,
    "furnace": _furnace,
    "probe": _probe,
    "beyond_stated": _beyond_stated,
    "box_beside": _box_beside,
    "box_above": _box_above,
    "srgb_from_linear": _encode,
    "sample_sums": _greys,
    "point_irradiance": _irradiance,
}
