"""Which lights something could stand before, and which triangles could so lose their light.

A necessary condition, not a sufficient one: it may only err towards shadows. For a triangle R to be
hidden from a light it has to face it; a corner of something has to lie in front of its plane; and
the plane of some triangle T has to have the light on one side and a corner of such an R on the
other. A floor, a body that is convex and alone, or a convex room around a lamp do not fulfil both.
Corners are those of the scene where these are few, else those of its box, which reach farther.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.shading import HideableLight
from catoptra_server.scene.description import DirectionalLight
from catoptra_server.scene.meshes import SceneMesh

# Corners this near a plane lie in it: what is built of sums of float64 differs by less.
_IN_PLANE_M = 1e-6
# Planes that a light lies in hide nothing from it.
_ALONG = 1e-9
# So many products of planes and corners are a tenth of a second; beyond, a box stands for corners.
_MOST_PRODUCTS = 3 * 10**7


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """Points for supports to be asked of: (m, 3); no point of what they stand for lies outside."""

    points: Floats

    @classmethod
    def around(cls, corners: Floats, *, planes: int) -> Hull:
        """Return the corners of (n, 3, 3) triangles, or of their box where they are many."""
        points = corners.reshape(-1, 3)
        if planes * len(points) <= _MOST_PRODUCTS:
            return cls(np.unique(points, axis=0))
        low, high = points.min(axis=0), points.max(axis=0)
        choose = np.indices((2, 2, 2)).reshape(3, -1).T
        return cls(np.where(choose == 1, high, low))

    def farthest(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""
        if not len(self.points):
            return np.full(len(normals), -np.inf)
        greatest = np.full(len(normals), -np.inf)
        # A few points at a time: all products at once would be gigabytes.
        for part in np.array_split(self.points, -(-len(self.points) // 64)):
            np.maximum(greatest, (normals @ part.T).max(axis=1), out=greatest)
        return greatest


def hideable_facets(scene: SceneMesh, light: HideableLight) -> Bools:
    """Return (n,) which triangles a light reaches that something of the scene might hide it from.

    Conservative: see above.
    """
    none = np.zeros(len(scene), dtype=bool)
    casting = scene.corners[scene.casts_shadows]
    if not len(casting):
        return none
    facing = _heights(scene, light) > 0.0
    facing &= ~scene.unlit & scene.albedo.any(axis=-1)
    receivers = np.flatnonzero(facing)
    hull = Hull.around(casting, planes=len(receivers))
    normals = scene.normals[receivers]
    beyond = hull.farthest(normals) - _offsets(scene, receivers) > _IN_PLANE_M
    receivers = receivers[beyond]
    if not len(receivers) or not _separates(scene, light, scene.corners[receivers]):
        return none
    none[receivers] = True
    return none


def _separates(scene: SceneMesh, light: HideableLight, corners: Floats) -> bool:
    """Return whether some caster's plane lies between a light and a corner of (k, 3, 3)."""
    casters = np.flatnonzero(scene.casts_shadows)
    height = _heights(scene, light)[casters]
    casters, height = casters[np.abs(height) > _ALONG], height[np.abs(height) > _ALONG]
    away = -np.sign(height)[:, None] * scene.normals[casters]
    offset = -np.sign(height) * _offsets(scene, casters)
    hull = Hull.around(corners, planes=len(casters))
    return bool((hull.farthest(away) - offset > _IN_PLANE_M).any())


def _heights(scene: SceneMesh, light: HideableLight) -> Floats:
    """Return (n,) how far in front of each triangle's plane a light is; a sun's is a cosine."""
    if isinstance(light, DirectionalLight):
        cosine: Floats = -(scene.normals @ np.asarray(light.direction))
        return cosine
    at = np.asarray(light.position_m) - scene.corners[:, 0]
    height: Floats = np.einsum("ni,ni->n", scene.normals, at)
    return height


def _offsets(scene: SceneMesh, which: np.ndarray) -> Floats:
    offsets: Floats = np.einsum("ni,ni->n", scene.normals[which], scene.corners[which, 0])
    return offsets
