"""Which lights something could stand before, and which triangles could so lose their light.

A necessary condition, not a sufficient one: it may only err towards shadows. For a triangle R to be
hidden from a light it has to face it; a corner of something has to lie in front of its plane; and
the plane of some triangle T has to have the light on one side and a corner of such an R on the
other. A floor, a body that is convex and alone, or a convex room around a lamp do not fulfil both.
Corners are those of the scene where these are few, else those of its box, which reach farther.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight

# Corners this near a plane lie in it: what is built of sums of float64 differs by less.
_IN_PLANE_M = 1e-6
# Planes that a light lies in hide nothing from it.
_MIN_LIGHT_DISTANCE = 1e-9
# So many products of planes and corners are a tenth of a second; beyond, a box stands for corners.
_MAX_PRODUCTS = 10**7
_NUM_PROBED_TRIANGLES = 500


class ConvexBound(Protocol):
    """Something that no point of what it stands for lies outside of."""

    def support(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """The points themselves: (m, 3)."""

    points: Floats

    def support(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""
        farthest: Floats = (normals @ self.points.T).max(axis=1)
        return farthest


@dataclass(frozen=True, slots=True, eq=False)
class AxisAlignedBox:
    """All points between two corners, (3,) each."""

    low: Floats
    high: Floats

    def support(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""
        half = 0.5 * (self.high - self.low)
        farthest: Floats = normals @ (self.low + half) + np.abs(normals) @ half
        return farthest


def make_bound(corners: Floats, *, num_planes: int) -> ConvexBound:
    """Return what to ask, of so many planes, for (n, 3, 3) triangles; at least one triangle."""
    points = corners.reshape(-1, 3)
    if num_planes * len(points) <= _MAX_PRODUCTS:
        return PointSet(np.unique(points, axis=0))
    low, high = ([extreme(points[:, k]) for k in range(3)] for extreme in (np.min, np.max))
    return AxisAlignedBox(np.array(low), np.array(high))


def shadow_candidates(scene: SceneMesh, light: ShadowCastingLight) -> Bools:
    """Return (n,) which triangles a light reaches that something of the scene might hide it from.

    Conservative: see above.
    """
    none = np.zeros(len(scene), dtype=bool)
    casting = scene.corners[scene.casts_shadows]
    if not len(casting):
        return none
    facing = _signed_light_distances(scene, light) > 0.0
    facing &= ~scene.unlit & scene.albedo.any(axis=-1)
    receivers = np.flatnonzero(facing)
    hull = make_bound(casting, num_planes=len(receivers))
    normals = scene.normals[receivers]
    beyond = hull.support(normals) - _plane_offsets(scene, receivers) > _IN_PLANE_M
    receivers = receivers[beyond]
    if not len(receivers) or not _has_separating_plane(scene, light, scene.corners[receivers]):
        return none
    none[receivers] = True
    return none


def _has_separating_plane(scene: SceneMesh, light: ShadowCastingLight, corners: Floats) -> bool:
    """Return whether some caster's plane lies between a light and a corner of (k, 3, 3)."""
    casters = np.flatnonzero(scene.casts_shadows)
    height = _signed_light_distances(scene, light)[casters]
    casters, height = (
        casters[np.abs(height) > _MIN_LIGHT_DISTANCE],
        height[np.abs(height) > _MIN_LIGHT_DISTANCE],
    )
    away = -np.sign(height)[:, None]
    hull = make_bound(corners, num_planes=len(casters))
    # In most scenes a few triangles show it.
    for part in (slice(None, None, 1 + len(casters) // _NUM_PROBED_TRIANGLES), slice(None)):
        normals = away[part] * scene.normals[casters[part]]
        offset = away[part, 0] * _plane_offsets(scene, casters[part])
        if (hull.support(normals) - offset > _IN_PLANE_M).any():
            return True
    return False


def _signed_light_distances(scene: SceneMesh, light: ShadowCastingLight) -> Floats:
    """Return (n,) how far in front of each triangle's plane a light is; a sun's is a cosine."""
    if isinstance(light, DirectionalLight):
        cosine: Floats = -(scene.normals @ np.asarray(light.direction))
        return cosine
    at = np.asarray(light.position_m) - scene.corners[:, 0]
    height: Floats = np.einsum("ni,ni->n", scene.normals, at)
    return height


def _plane_offsets(scene: SceneMesh, triangles: np.ndarray) -> Floats:
    offsets: Floats = np.einsum("ni,ni->n", scene.normals[triangles], scene.corners[triangles, 0])
    return offsets
