"""Bounding volume hierarchy that finds the distance of a triangle set in each ring of the image.

Neighbouring triangles share a box, neighbouring boxes a larger one. A query holds for all
viewpoints of a box at once, so its result can be cached. A triangle is bounded by its own box,
rotated with the mirror axis, and by its own plane. Occlusion is not considered: a hidden triangle
counts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.image_rings import (
    ImageRings,
    box_distance_bounds,
    plane_distance_bounds,
)
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.world.triangles import make_clusters

Indices = npt.NDArray[np.intp]

# Triangles a leaf, and boxes a parent.
_BRANCHING = 16
_MAX_ROOTS = 128
# A box that cannot lower the bound below this fraction is not refined.
_REFINE_FRACTION = 0.95
# Boxes refined a ring and step: enough for NumPy's overhead to vanish, few enough for the next step
# to profit from the bounds found.
_BATCH_SIZE = 8
# Some 5 ms.
MAX_TRIANGLES = 2**14


@dataclass(frozen=True, slots=True, eq=False)
class ViewpointBox:
    """Box of viewpoints that share a mirror axis, in the triangles' frame."""

    centre: Floats
    """(3,) metres."""
    half_extent: Floats
    """(3,) metres; zero for a single viewpoint."""
    axis_rotation: Floats
    """(3, 3) to axes whose z is the mirror axis."""


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """Boxes of one level, (n, 3) each."""

    centre: Floats
    half_extent: Floats

    def bounds(self, indices: Indices, viewpoints: ViewpointBox, rings: ImageRings) -> Floats:
        """(m, NUM_RINGS) bounds of the boxes at some indices."""
        centre = (self.centre[indices] - viewpoints.centre) @ viewpoints.axis_rotation.T
        half = (self.half_extent[indices] + viewpoints.half_extent) @ np.abs(
            viewpoints.axis_rotation
        ).T
        return box_distance_bounds(centre - half, centre + half, rings)


@dataclass(frozen=True, slots=True, eq=False)
class _NodeBounds:
    """Boxes of one level with their bounds."""

    level: int
    nodes: Indices
    """(n,) indices within the level."""
    bounds: Floats
    """(n, NUM_RINGS) metres."""

    def select(self, mask: Bools) -> _NodeBounds:
        """Boxes of a (n,) mask."""
        return _NodeBounds(self.level, self.nodes[mask], self.bounds[mask])

    def split_nearest(self, cutoff: Floats) -> tuple[_NodeBounds, _NodeBounds]:
        """Boxes that are nearest in any ring and nearer than the (NUM_RINGS,) cutoff; and the
        rest."""
        is_nearest = np.ones(len(self.nodes), dtype=bool)
        # A partial sort by ring: the union over the rings is at most NUM_RINGS * _BATCH_SIZE boxes.
        if len(is_nearest) > _BATCH_SIZE:
            open_bounds = np.where(self.bounds < cutoff, self.bounds, np.inf)
            is_nearest[:] = False
            is_nearest[np.argpartition(open_bounds, _BATCH_SIZE, axis=0)[:_BATCH_SIZE]] = True
        return self.select(is_nearest), self.select(~is_nearest)


class RingDistanceBvh:
    """Hierarchy over (n, 3, 3) corners and (n, 3) normals."""

    def __init__(self, corners: Floats, normals: Floats) -> None:
        clusters = make_clusters(corners, np.zeros(len(corners), dtype=np.intp), size=_BRANCHING)
        self._corners = corners
        self._normals = normals
        self._order = clusters.order
        low, high = clusters.box_min, clusters.box_max
        # Leaves first, roots last.
        self._levels: list[_Boxes] = []
        while len(low):
            self._levels.append(_Boxes(0.5 * (low + high), 0.5 * (high - low)))
            if len(low) <= _MAX_ROOTS:
                break
            first = np.arange(0, len(low), _BRANCHING)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)

    def bounds(
        self,
        viewpoints: ViewpointBox,
        rings: ImageRings,
        *,
        cutoff: Floats | None = None,
        max_triangles: int = MAX_TRIANGLES,
    ) -> Floats:
        """Distance within which no ring shows a triangle.

        Args:
            viewpoints: Viewpoints for which the result must hold.
            cutoff: (NUM_RINGS,) distances; boxes beyond are not refined.
            max_triangles: Number of triangles after which no box is refined; boxes then count as a
                whole, which is safe and loose.

        Returns:
            (NUM_RINGS,) metres; inf for a ring without triangles.
        """
        nearest = np.full(NUM_RINGS, np.inf) if cutoff is None else cutoff / _REFINE_FRACTION
        found = np.full(NUM_RINGS, np.inf)
        pending = [self._root_bounds(viewpoints, rings)] if self._levels else []
        while pending:
            group = pending.pop()
            is_needed = np.asarray(
                (group.bounds < _REFINE_FRACTION * nearest).any(axis=1) & (max_triangles > 0)
            )
            # Boxes that are not refined count with their own bound.
            found = np.minimum(found, group.bounds[~is_needed].min(axis=0, initial=np.inf))
            if not is_needed.any():
                continue
            nearest_group, others = group.select(is_needed).split_nearest(
                _REFINE_FRACTION * nearest
            )
            if len(others.nodes):
                pending.append(others)
            if group.level > 0:
                pending.append(self._child_bounds(nearest_group, viewpoints, rings))
                continue
            positions = _child_indices(nearest_group.nodes, len(self._order))
            found = np.minimum(
                found, self._triangle_bounds(positions, viewpoints, rings).min(axis=0)
            )
            nearest = np.minimum(nearest, found)
            max_triangles -= len(positions)
        return found

    def _root_bounds(self, viewpoints: ViewpointBox, rings: ImageRings) -> _NodeBounds:
        nodes = np.arange(len(self._levels[-1].half_extent))
        return _NodeBounds(
            len(self._levels) - 1, nodes, self._levels[-1].bounds(nodes, viewpoints, rings)
        )

    def _child_bounds(
        self, parents: _NodeBounds, viewpoints: ViewpointBox, rings: ImageRings
    ) -> _NodeBounds:
        boxes = self._levels[parents.level - 1]
        nodes = _child_indices(parents.nodes, len(boxes.half_extent))
        return _NodeBounds(parents.level - 1, nodes, boxes.bounds(nodes, viewpoints, rings))

    def _triangle_bounds(
        self, positions: Indices, viewpoints: ViewpointBox, rings: ImageRings
    ) -> Floats:
        """(m, NUM_RINGS) bounds of the triangles at (m,) positions of the order."""
        triangles = self._order[positions]
        corners, normals = self._corners[triangles] - viewpoints.centre, self._normals[triangles]
        rotated = corners @ viewpoints.axis_rotation.T
        half = np.abs(viewpoints.axis_rotation) @ viewpoints.half_extent
        to_box = box_distance_bounds(rotated.min(axis=1) - half, rotated.max(axis=1) + half, rings)
        along = (corners @ normals[:, :, None])[..., 0]
        in_front, behind = along.min(axis=1), -along.max(axis=1)
        distance = np.maximum(
            np.maximum(in_front, behind) - np.abs(normals) @ viewpoints.half_extent, 0.0
        )
        # All corners lie on one side of a plane, and so does the triangle: this holds for any
        # normal, so that of a degenerate triangle does no harm.
        cosine = (normals @ viewpoints.axis_rotation[2]) * np.where(in_front >= behind, 1.0, -1.0)
        return np.maximum(to_box, plane_distance_bounds(distance, cosine, rings))


def _child_indices(nodes: Indices, count: int) -> Indices:
    """Indices of the children of nodes, in a level of `count` members."""
    children = (nodes[:, None] * _BRANCHING + np.arange(_BRANCHING)).ravel()
    return children[children < count]
