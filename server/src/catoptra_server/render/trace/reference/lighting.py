"""Radiance of hits by `scene/shading`, with a ray to every light where there are shadows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.reference.placed_mesh import FirstHits, PlacedMesh, WorldRays
from catoptra_server.world import shading
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.world_description import Rgb

# Distance of a shadow ray's origin in front of its facet, relative to the largest coordinate of
# hit and camera: positions and corners are rounded to 2^-24 each, and a hit on a plane loses a few
# times that. 40 um at 10 m. Without it the facet itself would occlude its lights.
SHADOW_BIAS = 2.0**-18

RayIndices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """What shades the rays of an exposure."""

    centre: Floats
    """(3,) scene's centre in the world: origin of the rays' coordinates."""
    background: Rgb
    """Linear radiance of rays without a hit."""
    has_shadows: bool
    """Whether surfaces occlude directional and point lights."""


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points of one mesh to be lit."""

    positions: Floats
    """(n, 3) relative to the scene's centre."""
    normals: Floats
    """(n, 3) unit."""
    bias_m: Floats
    """(n,) distances of shadow rays from their facets."""


Record = TypeVar("Record", WorldRays, FirstHits, _Points)


def shade_hits(
    meshes: Sequence[PlacedMesh], rays: WorldRays, hits: FirstHits, lighting: Lighting
) -> Floats:
    """(n, 3) linear radiance along rays."""
    radiance: Floats = np.full(rays.origins.shape, lighting.background, dtype=np.float64)
    for number in range(len(meshes)):
        selected = np.flatnonzero(hits.object == number)
        if len(selected):
            placed = [mesh.take(selected) for mesh in meshes]
            radiance[selected] = _shade_mesh(
                placed, number, _take(rays, selected), _take(hits, selected), lighting
            )
    return radiance


def _take(record: Record, rays: RayIndices) -> Record:
    """Some of the rows of a record of arrays."""
    rows = {field.name: getattr(record, field.name).take(rays, axis=0) for field in fields(record)}
    return replace(record, **rows)


def _shade_mesh(
    meshes: Sequence[PlacedMesh], number: int, rays: WorldRays, hits: FirstHits, lighting: Lighting
) -> Floats:
    """(n, 3) radiance of rays that all meet one mesh."""
    mesh = meshes[number].mesh
    points = _lit_points(meshes[number], rays, hits)
    irradiance = _irradiance(meshes, number, points, lighting)
    if mesh.occlusion is not None:
        factors = mesh.occlusion.factors(hits.triangle, points.positions + lighting.centre)
        sky = shading.facet_irradiance(shading.hemisphere_lights(mesh.lights), points.normals)
        irradiance -= (1.0 - factors)[:, None] * sky
    irradiance[mesh.facets.unlit[hits.triangle]] = 1.0
    return mesh.albedo_at(hits, rays) * irradiance


def _lit_points(placed: PlacedMesh, rays: WorldRays, hits: FirstHits) -> _Points:
    """Positions and normals of hits."""
    positions = rays.origins + hits.distance[:, None] * rays.directions
    normals = placed.world_from_mesh.normals(placed.mesh.facets.normals.take(hits.triangle, axis=0))
    largest = np.maximum(np.abs(positions), np.abs(rays.origins)).max(axis=-1)
    return _Points(positions, normals, SHADOW_BIAS * largest)


def _irradiance(
    meshes: Sequence[PlacedMesh], number: int, points: _Points, lighting: Lighting
) -> Floats:
    """(n, 3) irradiance of points on one mesh."""
    lights = meshes[number].mesh.lights
    in_world = points.positions + lighting.centre
    if not lighting.has_shadows:
        total = shading.facet_irradiance(lights, points.normals)
        return total + shading.point_irradiance(lights, in_world, points.normals)
    total = shading.facet_irradiance(shading.hemisphere_lights(lights), points.normals)
    for light in shading.shadow_casting_lights(lights):
        added = shading.unshadowed_irradiance(light, in_world, points.normals)
        # Only facets turned to the light send a ray; all others are dark anyway.
        facing = np.flatnonzero(added.any(axis=-1))
        placed = [mesh.take(facing) for mesh in meshes]
        lit = facing[~_find_occlusion(placed, light, _take(points, facing), lighting.centre)]
        total[lit] += added[lit]
    return total


def _find_occlusion(
    meshes: Sequence[PlacedMesh], light: ShadowCastingLight, points: _Points, centre: Floats
) -> Bools:
    """(n,) whether some mesh lies between points and a light."""
    origins = points.positions + points.bias_m[:, None] * points.normals
    directions, distance = shading.direction_to_light(light, origins + centre)
    is_occluded = np.zeros(len(origins), dtype=bool)
    for placed in meshes:
        transform = placed.world_from_mesh
        is_occluded |= placed.mesh.casters.occludes(
            transform.inverse_points(origins), transform.inverse_vectors(directions), distance
        )
    return is_occluded
