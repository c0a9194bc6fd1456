"""How lights look at what casts shadows: the projections of shadow maps, in float64. Knows no GL.

A light with a direction sees all casters at once, in parallel; a light at a place looks along the
six axes. What a map answers is which caster is the first along a light's ray through the middle of
a texel, so outlines of shadows are off by half a texel's diagonal: MAX_SIDE_TEXELS says how much that
is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.depth_range import min_distance_bound
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight, PointLight

# Texels a side of a map, while there are few: a field of 12 m takes 6 mm a texel, a corridor of
# 19 m 9 mm, a robot 0.5 mm; a lamp's faces of 90 degrees take 1 mm a metre of distance. At 640 px
# a pixel that looks at a floor from 0.6 m sees 4 mm of it at its nearest, centimetres far off.
MAX_SIDE_TEXELS = 2048
# All maps together have at most so many texels, 4 bytes each; more lights get smaller maps.
MAX_TOTAL_TEXELS = 2**25
# A caster on the border of a map would be cut; facets on its far plane are moved back a little.
_MARGIN = 1.02
_DEPTH_MARGIN_M = 0.1
# What is nearer to a lamp than this casts no shadow.
_MIN_NEAR_M = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class ShadowProjection:
    """One map. clip_from_scene: (4, 4), from the scene's frame.

    half_texel_diagonal_m: half a texel's diagonal, in metres: of a lamp's map at a metre's distance ahead.
    depth: (a, b) of a lamp's map, depth = a + b / forward in [0, 1].
    """

    clip_from_scene: Floats
    half_texel_diagonal_m: float
    depth_from_forward: tuple[float, float] = (0.0, 0.0)

    def map_from_offset(self, viewpoint: Floats) -> Floats:
        """Return (4, 4): from places relative to a (3,) viewpoint to [0, 1] in the map."""
        halves = np.diag((0.5, 0.5, 0.5, 1.0))
        halves[:3, 3] = 0.5
        moved = np.eye(4)
        moved[:3, 3] = viewpoint
        mapped: Floats = halves @ self.clip_from_scene @ moved
        return mapped


@dataclass(frozen=True, slots=True, eq=False)
class ShadowCasters:
    """What casts shadows, for frames to be fitted around: spheres in the scene's frame.

    centres: (n, 3), radii: (n,) metres. Triangles' corners are spheres without extent. nearest:
    (k,) metres from k lamps that nothing of it is nearer to.
    """

    centres: Floats
    radii: Floats
    min_distances_m: tuple[float, ...] = ()

    @classmethod
    def from_triangles(
        cls, corners: Floats, normals: Floats, *, light_positions: tuple[Floats, ...]
    ) -> ShadowCasters:
        """Return (n, 3, 3) triangles; at least one."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        offsets = np.einsum("ni,ni->n", normals, corners[:, 0])
        nearest = (
            min_distance_bound(low, high, normals, offsets, point=lamp) for lamp in light_positions
        )
        points = corners.reshape(-1, 3)
        return cls(points, np.zeros(len(points)), tuple(nearest))

    @classmethod
    def from_objects(
        cls,
        objects: tuple[DynamicObject, ...],
        *,
        origin: Floats,
        light_positions: tuple[Floats, ...],
    ) -> ShadowCasters:
        """Return the spheres around bodies."""
        centres = np.array([body.centre - origin for body in objects])
        radii = np.array([body.mesh.radius_m for body in objects])
        nearest = (float((_distances(centres, lamp) - radii).min()) for lamp in light_positions)
        return cls(centres, radii, tuple(nearest))


def fit_shadow_projections(
    lights: tuple[ShadowCastingLight, ...],
    casters: ShadowCasters,
    *,
    origin: Floats,
    side_texels: int,
) -> tuple[ShadowProjection, ...]:
    """Return the maps of lights, those with a direction first: one each, or six."""
    return tuple(_iterate_projections(lights, casters, origin, side_texels))


def _iterate_projections(
    lights: tuple[ShadowCastingLight, ...], casters: ShadowCasters, origin: Floats, side_texels: int
) -> Iterator[ShadowProjection]:
    near = iter(casters.min_distances_m)
    for light in lights:
        if isinstance(light, DirectionalLight):
            yield _fit_directional_light(light, casters, side_texels)
        else:
            yield from _fit_point_light(light, casters, origin, (next(near), side_texels))


def _fit_directional_light(
    light: DirectionalLight, casters: ShadowCasters, side_texels: int
) -> ShadowProjection:
    axes = _light_axes(np.asarray(light.direction))
    along = casters.centres @ axes.T
    low = (along - casters.radii[:, None]).min(axis=0)
    high = (along + casters.radii[:, None]).max(axis=0)
    extent = float((high - low)[:2].max())
    half = 0.5 * _MARGIN * np.array((extent, extent, float(high[2] - low[2])))
    half += (1e-3, 1e-3, _DEPTH_MARGIN_M)
    clip = np.eye(4)
    clip[:3, :3] = axes / half[:, None]
    clip[:3, 3] = -0.5 * (low + high) / half
    return ShadowProjection(clip, float(np.sqrt(2.0) * half[0] / side_texels))


def _light_axes(direction: Floats) -> Floats:
    """Return (3, 3) unit axes, the last along a direction, the first level or across x."""
    level = np.cross(direction, (0.0, 0.0, 1.0))
    across = level if np.linalg.norm(level) > 1e-6 else np.cross(direction, (0.0, 1.0, 0.0))
    across = across / np.linalg.norm(across)
    return np.stack((across, np.cross(direction, across), direction))


def _fit_point_light(
    light: PointLight, casters: ShadowCasters, origin: Floats, near_and_side: tuple[float, int]
) -> Iterator[ShadowProjection]:
    at = np.asarray(light.position_m) - origin
    nearest, side = near_and_side
    # The corner of a face is root 3 as far away as its middle.
    near = max(nearest / np.sqrt(3.0), _MIN_NEAR_M)
    far = max(float((_distances(casters.centres, at) + casters.radii).max()), near)
    far = _MARGIN * far + _DEPTH_MARGIN_M
    a, b = (far + near) / (far - near), -2.0 * far * near / (far - near)
    for axis in range(3):
        for sign in (1.0, -1.0):
            clip = np.zeros((4, 4))
            clip[0, (axis + 1) % 3] = clip[1, (axis + 2) % 3] = 1.0
            clip[2, axis], clip[3, axis] = a * sign, sign
            clip[:, 3] = -clip[:, :3] @ at
            clip[2, 3] += b
            yield ShadowProjection(clip, np.sqrt(2.0) / side, (0.5 + 0.5 * a, 0.5 * b))


def _distances(points: Floats, at: Floats) -> Floats:
    distance: Floats = np.linalg.norm(points - at, axis=-1)
    return distance
