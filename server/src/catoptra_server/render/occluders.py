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
from catoptra_server.render.shading import HideableLight
from catoptra_server.scene.description import DirectionalLight
from catoptra_server.scene.meshes import SceneMesh

# Corners this near a plane lie in it: what is built of sums of float64 differs by less.
_IN_PLANE_M = 1e-6
# Planes that a light lies in hide nothing from it.
_ALONG = 1e-9
# So many products of planes and corners are a tenth of a second; beyond, a box stands for corners.
_MOST_PRODUCTS = 10**7
_ASKED_FIRST = 500


class Hull(Protocol):
    """Something that no point of what it stands for lies outside of."""

    def farthest(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """The points themselves: (m, 3)."""

    points: Floats

    def farthest(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""
        farthest: Floats = (normals @ self.points.T).max(axis=1)
        return farthest


@dataclass(frozen=True, slots=True, eq=False)
class AlignedBox:
    """All points between two corners, (3,) each."""

    low: Floats
    high: Floats

    def farthest(self, normals: Floats) -> Floats:
        """Return the (n,) greatest product of a point with each of (n, 3) normals."""
        half = 0.5 * (self.high - self.low)
        farthest: Floats = normals @ (self.low + half) + np.abs(normals) @ half
        return farthest


def hull_of(corners: Floats, *, planes: int) -> Hull:
    """Return what to ask, of so many planes, for (n, 3, 3) triangles; at least one triangle."""
    points = corners.reshape(-1, 3)
    if planes * len(points) <= _MOST_PRODUCTS:
        return Points(np.unique(points, axis=0))
    low, high = ([extreme(points[:, k]) for k in range(3)] for extreme in (np.min, np.max))
    return AlignedBox(np.array(low), np.array(high))


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
    hull = hull_of(casting, planes=len(receivers))
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
    away = -np.sign(height)[:, None]
    hull = hull_of(corners, planes=len(casters))
    # In most scenes a few triangles show it.
    for part in (slice(None, None, 1 + len(casters) // _ASKED_FIRST), slice(None)):
        normals = away[part] * scene.normals[casters[part]]
        offset = away[part, 0] * _offsets(scene, casters[part])
        if (hull.farthest(normals) - offset > _IN_PLANE_M).any():
            return True
    return False


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
