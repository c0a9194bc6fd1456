"""Exact distances from a point to triangles."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats


def triangle_distances(point: Floats, corners: Floats) -> Floats:
    """(n,) distances from a (3,) point to (n, 3, 3) triangles; those without area count as lines.

    Ericson 2005, Real-Time Collision Detection, 5.1.5: the plane's distance where the point's
    projection lies within the triangle, else that of the nearest edge.
    """
    corner = corners - point
    edge = np.roll(corner, -1, axis=1) - corner
    to_edges: Floats = _segment_distances(corner, edge).min(axis=1)
    normal = np.cross(edge[:, 0], edge[:, 1])
    length = np.linalg.norm(normal, axis=-1)
    has_area = length > 0.0
    to_plane = np.abs((corner[:, 0] * normal).sum(axis=-1)) / np.where(has_area, length, 1.0)
    is_above = has_area & _projects_inside(corner, edge, normal)
    return np.where(is_above, to_plane, to_edges)


def _segment_distances(start: Floats, edge: Floats) -> Floats:
    """(..., ) distances of the origin from segments."""
    square = np.square(edge).sum(axis=-1)
    along = -(start * edge).sum(axis=-1) / np.where(square > 0.0, square, 1.0)
    nearest = start + np.clip(along, 0.0, 1.0)[..., None] * edge
    distances: Floats = np.linalg.norm(nearest, axis=-1)
    return distances


def _projects_inside(corner: Floats, edge: Floats, normal: Floats) -> Bools:
    """(n,) whether the origin lies on the inner side of all edges, seen along the normal."""
    sides = (np.cross(edge, -corner) * normal[:, None]).sum(axis=-1)
    return np.asarray((sides >= 0.0).all(axis=1))
