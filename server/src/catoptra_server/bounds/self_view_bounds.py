"""Extent and distance of a robot in its own mirror, for each camera computed once.

Robot and mirror move as one, so the result does not change from frame to frame. Extremes of the
angle from the axis lie at corners or on edges, or are 0 or pi for a triangle that contains a pole.
Source: spherical trigonometry; on the great circle through two points, the direction farthest from
an axis is the opposite of the axis, projected into the circle's plane.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import ObjectMesh

# The relative pose is constant but for rounding: equal to a nanometre, so one cache key.
_DECIMALS = 9
_FLIP_Z = np.array((1.0, 1.0, -1.0))

FloatTuple = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SelfViewBounds:
    """Bounds of a body in the image of a camera on the body."""

    max_angle_rad: float = 0.0
    """Largest angle from the axis of any visible part; 0 for none."""
    min_distances_m: FloatTuple = (math.inf,) * NUM_RINGS
    """Distance bound of each ring."""


NOT_VISIBLE = SelfViewBounds()


def bound_self_view(camera_state: CameraState, camera: OmniCamera) -> SelfViewBounds:
    """Bounds of the robot that carries a camera, in the camera's image."""
    body = camera_state.ego_body
    if body is None:
        return NOT_VISIBLE
    pose = camera_state.world_from_mirror.inverse() @ body.world_from_object
    pose_values = np.concatenate((pose.rotation.ravel(), pose.translation)).round(_DECIMALS)
    return _bound_mesh(body.mesh, tuple(pose_values.tolist()), camera)


@lru_cache(maxsize=32)
def _bound_mesh(mesh: ObjectMesh, pose_values: FloatTuple, camera: OmniCamera) -> SelfViewBounds:
    # Numbers rather than a Pose as arguments: arrays are not hashable.
    pose = Pose(np.reshape(pose_values[:9], (3, 3)), np.array(pose_values[9:]))
    corners = pose.transform_points(mesh.corners)
    min_angle, max_angle = (
        math.pi - max_angle_from_axis(corners * _FLIP_Z),
        max_angle_from_axis(corners),
    )
    # Occlusion is not considered: a hidden part counts as visible.
    is_visible = min_angle <= camera.rim_rad
    if not is_visible.any():
        return NOT_VISIBLE
    distance = _min_distances(corners, pose.rotate_directions(mesh.normals))
    radius = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1) / camera.scale_px
    border = 2.0 * np.arctan(camera.projection.t_from_radius_ratio(radius))
    of_rings = (
        distance[(min_angle <= outer) & (max_angle >= inner)]
        for inner, outer in pairwise(border.tolist())
    )
    by_ring = tuple(float(of_ring.min(initial=math.inf)) for of_ring in of_rings)
    return SelfViewBounds(float(max_angle[is_visible].max()), by_ring)


def max_angle_from_axis(corners: Floats) -> Floats:
    """(n,) largest angle from +z of any point of (n, 3, 3) triangles."""
    angle = np.arctan2(np.hypot(corners[..., 0], corners[..., 1]), corners[..., 2])
    ends = np.roll(corners, -1, axis=1)
    farthest = np.maximum(angle.max(axis=1), _max_angle_on_edges(corners, ends).max(axis=1))
    return np.where(_contains_antipole(corners), math.pi, farthest)


def _max_angle_on_edges(starts: Floats, ends: Floats) -> Floats:
    """Largest angle from +z between the ends of edges; 0 where an end has the largest."""
    normal = np.cross(starts, ends)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(length > 0.0, length, 1.0)
    extreme = normal * normal[..., 2:] - np.array((0.0, 0.0, 1.0))
    after = np.einsum("...i,...i", np.cross(starts, extreme), normal) > 0.0
    before = np.einsum("...i,...i", np.cross(extreme, ends), normal) > 0.0
    # The extreme direction counts only between the ends, on the shorter arc.
    within = after & before & (length[..., 0] > 0.0)
    return np.where(within, math.pi - np.arcsin(np.minimum(np.abs(normal[..., 2]), 1.0)), 0.0)


def _contains_antipole(corners: Floats) -> Bools:
    """(n,) triangles of (n, 3, 3) that the ray along -z intersects."""
    a, b, c = np.moveaxis(corners, 1, 0)
    sides = np.stack([np.cross(p, q)[:, 2] for p, q in ((b, c), (c, a), (a, b))], axis=-1)
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))[:, None]
    # Barycentric weights of -z by Cramer's rule; all non-negative inside.
    weights = -sides * np.sign(volume)
    return np.asarray((weights >= 0.0).all(axis=-1) & (volume[:, 0] != 0.0))


def _min_distances(corners: Floats, normals: Floats) -> Floats:
    """(n,) distances from the origin within which there is no point of a triangle.

    The larger of the distances to the triangle's box and to its plane.
    """
    outside = np.maximum(np.maximum(corners.min(axis=1), -corners.max(axis=1)), 0.0)
    to_plane = np.abs(np.einsum("ni,ni->n", normals, corners[:, 0]))
    distance: Floats = np.maximum(np.linalg.norm(outside, axis=-1), to_plane)
    return distance
