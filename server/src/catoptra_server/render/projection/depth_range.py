"""The near and the far plane of a frame, from what the scene has around the viewpoint.

A depth buffer of 24 bits resolves d^2 / (near 2^24) at a distance d. A near plane that were always
close enough for a wall that touches the robot would let lines painted a millimetre above a floor
flicker from six metres on; so it is as far out as the nearest surface allows. Reversed depth, the
other remedy, needs a clip range of [0, 1], which OpenGL 3.3 has not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.triangle_clusters import TriangleClusters

# What is nearer than a millimetre is cut away.
MIN_NEAR_M = 0.001
# A near plane beyond this buys nothing: at 0.1 m the buffer resolves 0.25 mm at 20 m.
MAX_NEAR_M = 0.1
# The far plane lies this much beyond the farthest corner, for the rounding of depth.
FAR_MARGIN = 1.01


@dataclass(frozen=True, slots=True)
class DepthRange:
    """Distances along a face's axis between which surfaces are drawn."""

    near_m: float
    far_m: float

    @property
    def clip_z_from_w(self) -> tuple[float, float]:
        """Return (a, b) of z = a w + b: -w on the near plane, +w on the far one."""
        extent = self.far_m - self.near_m
        return (self.far_m + self.near_m) / extent, -2.0 * self.far_m * self.near_m / extent


class DepthRangeFinder:
    """Answers how near and how far the scene is from a point, in the scene's frame."""

    def __init__(self, clusters: TriangleClusters, corners: Floats) -> None:
        self._clusters = clusters
        ordered = corners[clusters.order]
        self._low = ordered.min(axis=1)
        self._high = ordered.max(axis=1)
        cross = np.cross(ordered[:, 1] - ordered[:, 0], ordered[:, 2] - ordered[:, 0])
        length = np.linalg.norm(cross, axis=-1, keepdims=True)
        self._normals = cross / np.where(length > 0.0, length, 1.0)
        self._offsets = np.einsum("ni,ni->n", self._normals, ordered[:, 0])

    def find_range(
        self,
        viewpoint: Floats,
        *,
        max_depth_ratio: float,
        object_distances_m: tuple[float, float] = (math.inf, 0.0),
    ) -> DepthRange:
        """Return the range for faces whose corners are `spread` metres away at one metre ahead.

        beside: the nearest and the farthest distance of what else is drawn.
        """
        nearest = min(
            self._min_distance(viewpoint, MAX_NEAR_M * max_depth_ratio), object_distances_m[0]
        )
        near = min(max(nearest / max_depth_ratio, MIN_NEAR_M), MAX_NEAR_M)
        farthest = max(self._max_distance(viewpoint), object_distances_m[1])
        return DepthRange(near, max(FAR_MARGIN * farthest, 2.0 * near))

    def _max_distance(self, viewpoint: Floats) -> float:
        """Return a distance within which all of the scene is."""
        if not len(self._offsets):
            return 0.0
        farthest = np.maximum(
            viewpoint - self._clusters.box_min.min(axis=0),
            self._clusters.box_max.max(axis=0) - viewpoint,
        )
        return math.hypot(*farthest)

    def _min_distance(self, viewpoint: Floats, cutoff_m: float) -> float:
        """Return a distance within which no surface is, at most `enough` metres.

        Of boxes that reach closer the triangles are asked: none is nearer than its own box or its
        own plane.
        """
        close = np.flatnonzero(self._clusters.distances(viewpoint) < cutoff_m)
        borders = self._clusters.offsets
        bounds = [
            self._bound_triangles(slice(borders[c], borders[c + 1]), viewpoint) for c in close
        ]
        return min(bounds, default=cutoff_m)

    def _bound_triangles(self, part: slice, viewpoint: Floats) -> float:
        return min_distance_bound(
            self._low[part],
            self._high[part],
            self._normals[part],
            self._offsets[part],
            point=viewpoint,
        )


def min_distance_bound(
    low: Floats, high: Floats, normals: Floats, offsets: Floats, *, point: Floats
) -> float:
    """Return a distance from a (3,) point within which none of n triangles is; at least one.

    low, high: (n, 3) of their boxes. normals (n, 3), offsets (n,): of their planes. No triangle is
    nearer than its own box or its own plane.
    """
    outside = np.maximum(np.maximum(low - point, point - high), 0.0)
    to_box = np.sqrt(np.square(outside).sum(axis=-1))
    to_plane = np.abs(normals @ point - offsets)
    return float(np.maximum(to_box, to_plane).min())
