"""Light: the sRGB curve, sums of samples, point lights, closed rooms, boxes, the sun."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.occlusion.light_bake import bake_light
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.render.trace.reference import reference_engine as ray_batches
from catoptra_server.world import shading
from catoptra_server.world import world_description as colour
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.sky import SkyDescription, compute_sunlight
from catoptra_server.world.world_description import Box, Item, Material, PointLight, World


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


def _furnace(albedo: float) -> float:
    """Baked irradiance in the middle of the floor of a closed room that emits the radiance 1."""
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
    light = bake_light(scene, world, 2, threads=1)
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
    "box_beside": _box_beside,
    "box_above": _box_above,
    "srgb_from_linear": _encode,
    "sample_sums": _greys,
    "point_irradiance": _irradiance,
}
