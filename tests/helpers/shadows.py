"""Worlds with shadows, and float64 images of them by testing every triangle."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)

DIM_HEMISPHERE_LIGHT = HemisphereLight((0.3, 0.3, 0.3), (0.2, 0.2, 0.2))
DIRECTIONAL_LIGHT = DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.5, 0.5))
POINT_LIGHT = PointLight((-0.4, 0.3, -1.3), (0.8, 0.7, 0.6))
GREY = Material((0.5, 0.5, 0.5))
# A shadow ray that passes this near an edge, as a share of a triangle, may go either way.
_EDGE_TOLERANCE = 1e-4
_SHADOW_BIAS_M = 1e-5


def floor_item(size_m: float = 4.0, material: Material = GREY) -> Item:
    """A floor at z = 0."""
    return Item("floor", Rectangle((size_m, size_m)), Pose.identity(), material)


def box_item(x: float, y: float, z: float, size_m: tuple[float, float, float]) -> Item:
    """A grey box."""
    return Item("box", Box(size_m), Pose.from_rpy((x, y, z), (0.0, 0.0, 0.4)), GREY)


def make_world(
    *items: Item, lights: tuple[Light, ...] = (DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
) -> World:
    """A world of items under lights, with a dark background."""
    return World("shadows", items, lights=lights, background=(0.1, 0.1, 0.1))


def make_inward_facing_room(light: Light) -> World:
    """An empty room of six inward faces, 4 x 4 x 2 m, with one light."""
    half = 0.5 * np.pi
    faces = (
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, -4.0), (np.pi, 0.0, 0.0)),
        ((2.0, 0.0, -2.0), (0.0, -half, 0.0)),
        ((-2.0, 0.0, -2.0), (0.0, half, 0.0)),
        ((0.0, 2.0, -2.0), (half, 0.0, 0.0)),
        ((0.0, -2.0, -2.0), (-half, 0.0, 0.0)),
    )
    items = (
        Item(f"face{n}", Rectangle((4.0, 4.0)), Pose.from_rpy(at, turn), GREY)
        for n, (at, turn) in enumerate(faces)
    )
    return make_world(*items, lights=(DIM_HEMISPHERE_LIGHT, light))


def reference_radiance(
    scene: SceneMesh, world: World, triangle: np.ndarray, points: Floats
) -> tuple[Floats, Bools]:
    """(n, 3) radiance of points on untextured triangles, and (n,) whether no edge is near."""
    irradiance = shading.facet_irradiance(
        shading.hemisphere_lights(world.lights), scene.normals[triangle]
    )
    is_certain = np.ones(len(points), dtype=bool)
    total = irradiance.copy()
    for light in shading.shadow_casting_lights(world.lights):
        normals = scene.normals[triangle]
        unshadowed = shading.unshadowed_irradiance(light, points, normals)
        to_light, light_distance = shading.direction_to_light(
            light, points + _SHADOW_BIAS_M * normals
        )
        is_occluded, is_doubtful = _occlusion(
            scene, points + _SHADOW_BIAS_M * normals, to_light, light_distance
        )
        total += np.where(is_occluded[:, None], 0.0, unshadowed)
        is_certain &= ~(is_doubtful & unshadowed.any(axis=-1))
    unlit = scene.unlit[triangle, None]
    return scene.albedo[triangle] * np.where(unlit, 1.0, total), is_certain


def _occlusion(
    scene: SceneMesh, points: Floats, to_light: Floats, light_distance: Floats
) -> tuple[Bools, Bools]:
    """(n,) whether a triangle lies before a light, and whether an edge is near."""
    is_occluded, is_doubtful = (np.zeros(len(points), dtype=bool) for _ in range(2))
    for corners in scene.corners[scene.casts_shadows]:
        a, first, second = corners[0], corners[1] - corners[0], corners[2] - corners[0]
        p = np.cross(to_light, second)
        determinant = p @ first
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ni,ni->n", p, points - a) / determinant
            q = np.cross(points - a, first)
            v = np.einsum("ni,ni->n", q, to_light) / determinant
            distance = q @ second / determinant
            edge = np.minimum(np.minimum(u, v), 1.0 - u - v)
            between = (distance > 0.0) & (distance < light_distance)
        is_occluded |= between & (edge >= 0.0)
        is_doubtful |= between & (np.abs(edge) < _EDGE_TOLERANCE)
    return is_occluded, is_doubtful
