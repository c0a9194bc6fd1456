"""What a robot bumps into: the scene's triangles between ankle and mirror height, seen from above.

A robot is a rectangle on the floor. Two convex shapes are apart iff some edge normal separates
them, which is tested for all near triangles at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.meshes import SceneMesh

# Things lower than this are driven over: carpets, lines, sills.
CLEARANCE_M = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Triangles from above: corners (n, 3, 2) in metres, world frame, and their bounds (n, 2)."""

    corners: Floats
    lower: Floats
    upper: Floats

    def near(self, centre: Floats, radius_m: float) -> Floats:
        """Return the (m, 3, 2) triangles whose bounds reach into a circle's square."""
        inside = (self.lower <= centre + radius_m) & (self.upper >= centre - radius_m)
        return self.corners[inside.all(axis=-1)]


def obstacles_between(scene: SceneMesh, *, low_m: float, high_m: float) -> Obstacles:
    """Return the triangles that reach into a band of heights above the floor z = 0."""
    heights = -scene.corners[..., 2]
    inside = (heights.max(axis=1) > low_m) & (heights.min(axis=1) < high_m)
    corners = np.ascontiguousarray(scene.corners[inside][..., :2])
    return Obstacles(corners, corners.min(axis=1), corners.max(axis=1))


def rectangle_touches(
    obstacles: Obstacles, centre: Floats, yaw_rad: float, *, half_size_m: tuple[float, float]
) -> bool:
    """Return whether a rectangle (half length, half width) at (2,), turned, meets a triangle."""
    triangles = obstacles.near(centre, float(np.hypot(*half_size_m))) - centre
    if not len(triangles):
        return False
    forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    left = np.array([forward[1], -forward[0]])
    halves = np.stack((half_size_m[0] * forward, half_size_m[1] * left))
    edges = np.roll(triangles, -1, axis=1) - triangles
    normals = np.stack((edges[..., 1], -edges[..., 0]), axis=-1)
    own = np.broadcast_to(halves, (len(triangles), 2, 2))
    apart = _apart(triangles, np.concatenate((own, normals), axis=1), halves)
    return bool((~apart).any())


def _apart(triangles: Floats, axes: Floats, halves: Floats) -> Bools:
    """Return (n,) whether one of (n, k, 2) axes parts (n, 3, 2) triangles from the rectangle."""
    along = np.einsum("nci,nki->nkc", triangles, axes)
    reach = np.abs(axes @ halves.T).sum(axis=-1)
    separated: Bools = ((along.min(axis=-1) > reach) | (along.max(axis=-1) < -reach)).any(axis=-1)
    return separated
