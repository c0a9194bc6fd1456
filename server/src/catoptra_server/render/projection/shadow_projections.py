"""Projections of shadow maps, in float64.

A directional light has one orthographic map of all casters; a point light has six perspective maps
along its axes. A map's texel holds the first caster along the light's ray through the texel's
centre, so silhouettes of shadows are off by half a texel's diagonal; MAX_SIDE_TEXELS gives sizes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.world_description import DirectionalLight

# Texels a side of a map, while there are few: in a field of 12 m a texel has 6 mm, in a corridor of
# 19 m 9 mm, on a robot 0.5 mm; on a point light's faces 1 mm a metre of distance. At 640 px a pixel
# covers 4 mm of a floor 0.6 m below the viewpoint at best, centimetres far off.
MAX_SIDE_TEXELS = 2048
# Limit for all maps together, 4 bytes a texel: 128 MiB. More lights get smaller maps.
MAX_TOTAL_TEXELS = 2**25
# A caster on a map's border would be clipped, and the slope bias moves facets beyond the far plane.
_MARGIN = 1.02
_DEPTH_MARGIN_M = 0.1
# Surfaces nearer to a point light than this cast no shadow: the near plane needs some distance.
_MIN_NEAR_M = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class ShadowProjection:
    """Projection of one shadow map."""

    clip_from_scene: Floats
    """(4, 4) clip matrix, from the scene's frame."""
    half_texel_diagonal_m: float
    """Half a texel's diagonal, metres; for a point light at one metre ahead of the light."""
    depth_from_forward: tuple[float, float] = (0.0, 0.0)
    """(a, b) of a point light's map: depth = a + b / forward, in [0, 1]."""

    def map_from_offset(self, viewpoint: Floats) -> Floats:
        """(4, 4) map from offsets from a (3,) viewpoint, scene frame, to [0, 1] in the map."""
        unit_from_clip = np.diag((0.5, 0.5, 0.5, 1.0))
        unit_from_clip[:3, 3] = 0.5
        scene_from_offset = np.eye(4)
        scene_from_offset[:3, 3] = viewpoint
        map_from_offset: Floats = unit_from_clip @ self.clip_from_scene @ scene_from_offset
        return map_from_offset


@dataclass(frozen=True, slots=True, eq=False)
class ShadowCasters:
    """Bounding spheres of shadow casters, scene frame, around which projections are fitted."""

    centres: Floats
    """(n, 3) centres; a triangle's corners are spheres of radius zero."""
    radii: Floats
    """(n,) radii, metres."""
    min_distances_m: tuple[float, ...] = ()
    """Lower bound on the distance of any caster from each point light, metres."""

    @classmethod
    def from_triangles(
        cls, corners: Floats, normals: Floats, *, light_positions: tuple[Floats, ...]
    ) -> ShadowCasters:
        """Casters of (n, 3, 3) triangles with (n, 3) normals, n >= 1."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        offsets = np.einsum("ni,ni->n", normals, corners[:, 0])
        min_distances = (
            _min_distance_bound(low, high, normals, offsets, point=position)
            for position in light_positions
        )
        points = corners.reshape(-1, 3)
        return cls(points, np.zeros(len(points)), tuple(min_distances))

    @classmethod
    def from_objects(
        cls,
        objects: tuple[DynamicObject, ...],
        *,
        origin: Floats,
        light_positions: tuple[Floats, ...],
    ) -> ShadowCasters:
        """Casters of dynamic objects: their bounding spheres."""
        centres = np.array([dynamic_object.centre - origin for dynamic_object in objects])
        radii = np.array([dynamic_object.mesh.radius_m for dynamic_object in objects])
        min_distances = (
            float((_distances(centres, position) - radii).min()) for position in light_positions
        )
        return cls(centres, radii, tuple(min_distances))


def fit_shadow_projections(
    lights: tuple[ShadowCastingLight, ...],
    casters: ShadowCasters,
    *,
    origin: Floats,
    side_texels: int,
) -> tuple[ShadowProjection, ...]:
    """Fit the maps of all lights around casters: one per directional light, six per point light.

    Args:
        lights: Shadow-casting lights, directional lights first.
        casters: Spheres that the maps must contain.
        origin: (3,) origin of the scene's frame in the world.
        side_texels: Texels along a map's side.
    """
    projections: list[ShadowProjection] = []
    min_distances = iter(casters.min_distances_m)
    for light in lights:
        if isinstance(light, DirectionalLight):
            projections.append(_fit_directional_light(light, casters, side_texels))
        else:
            position = np.asarray(light.position_m) - origin
            projections += _fit_point_light(position, casters, next(min_distances), side_texels)
    return tuple(projections)


def _fit_directional_light(
    light: DirectionalLight, casters: ShadowCasters, side_texels: int
) -> ShadowProjection:
    """Orthographic map around all casters, looking along the light."""
    axes = _light_axes(np.asarray(light.direction))
    projected = casters.centres @ axes.T
    low = (projected - casters.radii[:, None]).min(axis=0)
    high = (projected + casters.radii[:, None]).max(axis=0)
    # One side for u and v: square texels have one diagonal, so one bias fits both directions.
    extent = float((high - low)[:2].max())
    half = 0.5 * _MARGIN * np.array((extent, extent, float(high[2] - low[2])))
    # A flat or empty scene has no extent in some direction, which would divide by zero.
    half += (1e-3, 1e-3, _DEPTH_MARGIN_M)
    clip = np.eye(4)
    clip[:3, :3] = axes / half[:, None]
    clip[:3, 3] = -0.5 * (low + high) / half
    return ShadowProjection(clip, float(np.sqrt(2.0) * half[0] / side_texels))


def _light_axes(direction: Floats) -> Floats:
    """(3, 3) unit axes: the last along the light, the first horizontal or perpendicular to y."""
    horizontal = np.cross(direction, (0.0, 0.0, 1.0))
    right = (
        # A vertical light has no horizontal axis of its own; any axis across the light will do.
        horizontal if np.linalg.norm(horizontal) > 1e-6 else np.cross(direction, (0.0, 1.0, 0.0))
    )
    right = right / np.linalg.norm(right)
    return np.stack((right, np.cross(direction, right), direction))


def _fit_point_light(
    position: Floats, casters: ShadowCasters, min_distance: float, side_texels: int
) -> Iterator[ShadowProjection]:
    """Yield six perspective maps: +x, -x, +y, -y, +z, -z."""
    # A point in a face's corner is sqrt(3) times as far away as its depth along the face's axis.
    near = max(min_distance / np.sqrt(3.0), _MIN_NEAR_M)
    far = max(float((_distances(casters.centres, position) + casters.radii).max()), near)
    far = _MARGIN * far + _DEPTH_MARGIN_M
    a, b = (far + near) / (far - near), -2.0 * far * near / (far - near)
    for axis in range(3):
        for sign in (1.0, -1.0):
            # u and v are the next two axes in cyclic order for both signs: mirrored faces are
            # harmless, since a map stores only depths, and the shader needs no table of
            # orientations.
            clip = np.zeros((4, 4))
            clip[0, (axis + 1) % 3] = clip[1, (axis + 2) % 3] = 1.0
            clip[2, axis], clip[3, axis] = a * sign, sign
            clip[:, 3] = -clip[:, :3] @ position
            clip[2, 3] += b
            yield ShadowProjection(clip, np.sqrt(2.0) / side_texels, (0.5 + 0.5 * a, 0.5 * b))


def _distances(points: Floats, position: Floats) -> Floats:
    """Distances of (n, 3) points from a (3,) position."""
    distances: Floats = np.linalg.norm(points - position, axis=-1)
    return distances


def _min_distance_bound(
    low: Floats, high: Floats, normals: Floats, offsets: Floats, *, point: Floats
) -> float:
    """Lower bound on the distance from a point to the nearest of n triangles, n >= 1.

    No triangle is nearer than its box or its plane; the larger of the two is the bound.

    Args:
        low: (n, 3) least coordinates of the triangles.
        high: (n, 3) greatest coordinates.
        normals: (n, 3) unit normals of the triangles' planes.
        offsets: (n,) distances of the planes from the origin along the normals.
        point: (3,) position in the same frame.
    """
    outside = np.maximum(np.maximum(low - point, point - high), 0.0)
    to_box = np.sqrt(np.square(outside).sum(axis=-1))
    to_plane = np.abs(normals @ point - offsets)
    return float(np.maximum(to_box, to_plane).min())
