"""A ray caster in float64 that tests every triangle: the reference of the trace renderer.

Moeller & Trumbore 1997, and the shading model by its formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World, linear_from_srgb

# Rays this near an edge (in barycentric coordinates) or this near a second surface (in metres) may
# honestly go either way in float32.
_NEAR_EDGE = 1e-4
_NEAR_SURFACE_M = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceRadiance:
    """Radiance along rays."""

    radiance: Floats
    """(n, 3) linear radiance."""
    is_certain: Bools
    """(n,) False where float32 may hit another surface."""


def cast_rays(
    scene: SceneMesh, world: World, origin: Floats, directions: Floats
) -> ReferenceRadiance:
    """Radiance along (n, 3) directions from one origin (3,)."""
    distance, u, v = _distances(scene, origin, directions)
    triangle = np.argmin(distance, axis=1)
    rows = np.arange(len(directions))
    hit = np.isfinite(distance[rows, triangle])
    radiance = np.tile(np.asarray(world.background), (len(directions), 1))
    seen, which = rows[hit], triangle[hit]
    points = origin + distance[seen, which][:, None] * directions[seen]
    radiance[seen] = _radiance(scene, world, which, points, u[seen, which], v[seen, which])
    return ReferenceRadiance(radiance, _is_certain(distance, u, v))


def _distances(
    scene: SceneMesh, origin: Floats, directions: Floats
) -> tuple[Floats, Floats, Floats]:
    """(n, m) distances, inf for a miss, and the barycentric (u, v) of the hit of each plane."""
    a = scene.corners[:, 0]
    first, second = scene.corners[:, 1] - a, scene.corners[:, 2] - a
    p = np.cross(directions[:, None], second)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.einsum("nmi,mi->nm", p, first)
        to_origin = origin - a
        u = np.einsum("nmi,mi->nm", p, to_origin) * inverse
        q = np.cross(to_origin, first)
        v = (directions @ q.T) * inverse
        distance = np.einsum("mi,mi->m", second, q) * inverse
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return np.where(inside, distance, np.inf), u, v


def _is_certain(distance: Floats, u: Floats, v: Floats) -> Bools:
    """(n,) whether no edge of a triangle in front, nor a second surface, is near."""
    nearest = distance.min(axis=1)
    edge = np.minimum(np.minimum(np.abs(u), np.abs(v)), np.abs(1.0 - u - v)) < _NEAR_EDGE
    around = (u > -_NEAR_EDGE) & (v > -_NEAR_EDGE) & (u + v < 1.0 + _NEAR_EDGE)
    doubtful = (edge & around).any(axis=1)
    second = np.partition(distance, 1, axis=1)[:, 1]
    with np.errstate(invalid="ignore"):
        apart = ~(second - nearest < _NEAR_SURFACE_M)
    certain: Bools = ~doubtful & apart
    return certain


def _radiance(
    scene: SceneMesh, world: World, triangle: np.ndarray, points: Floats, u: Floats, v: Floats
) -> Floats:
    radiance = shading.facet_radiance(scene, world.lights)[triangle]
    point_irradiance = shading.point_irradiance(world.lights, points, scene.normals[triangle])
    radiance = radiance + np.where(
        scene.unlit[triangle, None], 0.0, scene.albedo[triangle] * point_irradiance
    )
    corners = scene.uv[triangle]
    uv = (1.0 - u - v)[:, None] * corners[:, 0] + u[:, None] * corners[:, 1]
    uv += v[:, None] * corners[:, 2]
    for index, texture in enumerate(scene.textures):
        on = scene.texture_index[triangle] == index
        radiance[on] *= shading.sample_texture(linear_from_srgb(texture / 255.0), uv[on])
    return radiance
