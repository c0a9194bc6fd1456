"""Triangles that could lie in a shadow: a necessary condition, computed without casting rays.

The condition errs towards shadows only. For a triangle R to be occluded from a light, R has to face
the light; a corner of some caster has to lie in front of R's plane; and the plane of some caster T
has to separate the light from a corner of such an R. A floor, a single convex object, or a convex
room around a point light do not meet all three. Corners are those of the scene where few, otherwise
those of the scene's box, which reaches farther.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.light_shafts import IN_PLANE_M, MIN_LIGHT_DISTANCE
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.shapes import bounding_box
from catoptra_server.world.triangles import select_rows
from catoptra_server.world.world_description import DirectionalLight

# A tenth of a second; beyond, a box stands for the corners.
_MAX_PRODUCTS = 10**7
_NUM_PROBED_TRIANGLES = 500


class ConvexBound(Protocol):
    """Convex set that contains all points of a scene."""

    def support(self, normals: Floats) -> Floats:
        """(n,) largest products of a point of the set with each of (n, 3) normals."""


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """The points themselves."""

    points: Floats
    """(m, 3)."""

    def support(self, normals: Floats) -> Floats:
        """(n,) largest products of a point with each of (n, 3) normals."""
        farthest: Floats = (normals @ self.points.T).max(axis=1)
        return farthest


@dataclass(frozen=True, slots=True, eq=False)
class AxisAlignedBox:
    """All points between two corners."""

    low: Floats
    """(3,)."""
    high: Floats
    """(3,)."""

    def support(self, normals: Floats) -> Floats:
        """(n,) largest products of a point with each of (n, 3) normals."""
        half = 0.5 * (self.high - self.low)
        farthest: Floats = normals @ (self.low + half) + np.abs(normals) @ half
        return farthest


def make_bound(corners: Floats, *, num_planes: int) -> ConvexBound:
    """Convex bound of (n, 3, 3) triangles, at least one: their points, or a box for many.

    Args:
        num_planes: Number of normals that the bound will be multiplied with.
    """
    points = corners.reshape(-1, 3)
    if num_planes * len(points) <= _MAX_PRODUCTS:
        return PointSet(np.unique(points, axis=0))
    return AxisAlignedBox(*bounding_box(corners))


def shadow_candidates(scene: SceneMesh, light: ShadowCastingLight) -> Bools:
    """(n,) triangles that the light faces and a surface of the scene might occlude."""
    none = np.zeros(len(scene), dtype=bool)
    # A copy of a million triangles takes a tenth of a second.
    casting = select_rows(scene.corners, scene.casts_shadows)
    if not len(casting):
        return none
    facing = _signed_light_distances(scene, light) > 0.0
    # Unlit and black surfaces look the same in a shadow.
    facing &= ~scene.unlit & np.logical_or.reduce(scene.albedo.T != 0.0)
    receivers = np.flatnonzero(facing)
    caster_bound = make_bound(casting, num_planes=len(receivers))
    normals = scene.normals.take(receivers, axis=0)
    has_point_in_front = (
        caster_bound.support(normals) - _plane_offsets(scene, receivers) > IN_PLANE_M
    )
    receivers = receivers[has_point_in_front]
    if not len(receivers) or not _has_separating_plane(
        scene, light, scene.corners.take(receivers, axis=0)
    ):
        return none
    none[receivers] = True
    return none


def _has_separating_plane(scene: SceneMesh, light: ShadowCastingLight, corners: Floats) -> bool:
    """Whether the plane of some caster separates the light from a corner of (k, 3, 3)."""
    casters = np.flatnonzero(scene.casts_shadows)
    height = _signed_light_distances(scene, light)[casters]
    casters, height = (
        casters[np.abs(height) > MIN_LIGHT_DISTANCE],
        height[np.abs(height) > MIN_LIGHT_DISTANCE],
    )
    # Normals turned away from the light: a receiver's corner then lies in front of the plane.
    away = -np.sign(height)[:, None]
    receiver_bound = make_bound(corners, num_planes=len(casters))
    # In most scenes a sample of the triangles already has such a plane.
    for part in (slice(None, None, 1 + len(casters) // _NUM_PROBED_TRIANGLES), slice(None)):
        normals = away[part] * scene.normals[casters[part]]
        offset = away[part, 0] * _plane_offsets(scene, casters[part])
        if (receiver_bound.support(normals) - offset > IN_PLANE_M).any():
            return True
    return False


def _signed_light_distances(scene: SceneMesh, light: ShadowCastingLight) -> Floats:
    """(n,) signed distance of the light from each plane; a cosine for directional lights."""
    if isinstance(light, DirectionalLight):
        cosine: Floats = -(scene.normals @ np.asarray(light.direction))
        return cosine
    to_light = np.asarray(light.position_m) - scene.corners[:, 0]
    height: Floats = np.einsum("ni,ni->n", scene.normals, to_light)
    return height


def _plane_offsets(scene: SceneMesh, triangles: np.ndarray) -> Floats:
    normals = scene.normals.take(triangles, axis=0)
    offsets: Floats = np.einsum("ni,ni->n", normals, scene.corners[:, 0].take(triangles, axis=0))
    return offsets
