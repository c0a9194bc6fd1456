"""How near a set of triangles comes in each ring of the image: a tree of boxes, asked as one.

Triangles that lie together share a box, boxes that lie together a larger one. A question is asked
for all viewpoints of a box at once, so that its answer can be kept. What a triangle is asked is
its own box, turned with the mirror's axis, and its own plane. What hides what is not asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.bounds.image_rings import (
    ImageRings,
    box_distance_bounds,
    plane_distance_bounds,
)
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.scene.triangle_clusters import make_clusters

Indices = npt.NDArray[np.intp]

# So many triangles a box, and boxes a larger box.
_BRANCHING = 16
_MAX_ROOTS = 128
# What is farther than this share of the nearest known is not looked at more closely.
_REFINE_FRACTION = 0.95
# So many boxes a ring are opened before it is looked again which others have to be.
_BATCH_SIZE = 8
# A question opens no more boxes when it has asked so many triangles: some 5 ms.
MAX_TRIANGLES = 2**14


@dataclass(frozen=True, slots=True, eq=False)
class ViewpointBox:
    """A box of viewpoints that share an axis, in the triangles' frame.

    middle, half: (3,) of the box. turn: (3, 3) to axes whose z is the mirror's axis.
    """

    centre: Floats
    half_extent: Floats
    axis_rotation: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """(n, 3) middles and halves of boxes."""

    centre: Floats
    half_extent: Floats

    def bounds(self, indices: Indices, viewpoints: ViewpointBox, rings: ImageRings) -> Floats:
        """Return the (m, RINGS) bounds of some of them."""
        middle = (self.centre[indices] - viewpoints.centre) @ viewpoints.axis_rotation.T
        half = (self.half_extent[indices] + viewpoints.half_extent) @ np.abs(
            viewpoints.axis_rotation
        ).T
        return box_distance_bounds(middle - half, middle + half, rings)


@dataclass(frozen=True, slots=True, eq=False)
class _NodeBounds:
    """(n,) boxes of a level, and their (n, RINGS) bounds."""

    level: int
    nodes: Indices
    bounds: Floats

    def select(self, mask: Bools) -> _NodeBounds:
        """Return those of a (n,) mask."""
        return _NodeBounds(self.level, self.nodes[mask], self.bounds[mask])

    def split_nearest(self, cutoff: Floats) -> tuple[_NodeBounds, _NodeBounds]:
        """Return what is nearest in any ring, if nearer than (RINGS,) `below`, and the rest."""
        is_urgent = np.ones(len(self.nodes), dtype=bool)
        if len(is_urgent) > _BATCH_SIZE:
            open_still = np.where(self.bounds < cutoff, self.bounds, np.inf)
            is_urgent[:] = False
            is_urgent[np.argpartition(open_still, _BATCH_SIZE, axis=0)[:_BATCH_SIZE]] = True
        return self.select(is_urgent), self.select(~is_urgent)


class RingDistanceBvh:
    """Triangles that can be asked how near they come: (n, 3, 3) corners and (n, 3) normals."""

    def __init__(self, corners: Floats, normals: Floats) -> None:
        chunks = make_clusters(corners, np.zeros(len(corners), dtype=np.intp), size=_BRANCHING)
        self._corners = corners
        self._normals = normals
        self._order = chunks.order
        low, high = chunks.box_min, chunks.box_max
        self._levels: list[_Boxes] = []  # from small to large
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
        """Return (RINGS,) distances within which no ring shows a triangle; inf where none is.

        enough: (RINGS,); what is not nearer is not looked at more closely. Nothing is, once `most`
        triangles have been asked: then boxes count that hold more than is seen.
        """
        nearest = np.full(NUM_RINGS, np.inf) if cutoff is None else cutoff / _REFINE_FRACTION
        found = np.full(NUM_RINGS, np.inf)
        waiting = [self._root_bounds(viewpoints, rings)] if self._levels else []
        while waiting:
            some = waiting.pop()
            is_needed = np.asarray(
                (some.bounds < _REFINE_FRACTION * nearest).any(axis=1) & (max_triangles > 0)
            )
            found = np.minimum(found, some.bounds[~is_needed].min(axis=0, initial=np.inf))
            if not is_needed.any():
                continue
            now, later = some.select(is_needed).split_nearest(_REFINE_FRACTION * nearest)
            if len(later.nodes):
                waiting.append(later)
            if some.level > 0:
                waiting.append(self._child_bounds(now, viewpoints, rings))
                continue
            places = _child_indices(now.nodes, len(self._order))
            found = np.minimum(found, self._triangle_bounds(places, viewpoints, rings).min(axis=0))
            nearest = np.minimum(nearest, found)
            max_triangles -= len(places)
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
        """Return the (m, RINGS) bounds of the triangles at (m,) places of the order.

        Corners lie behind a plane, and so does what is between them: this holds for any normal,
        so that of a triangle without area does no harm.
        """
        some = self._order[positions]
        corners, normals = self._corners[some] - viewpoints.centre, self._normals[some]
        turned = corners @ viewpoints.axis_rotation.T
        half = np.abs(viewpoints.axis_rotation) @ viewpoints.half_extent
        to_box = box_distance_bounds(turned.min(axis=1) - half, turned.max(axis=1) + half, rings)
        along = (corners @ normals[:, :, None])[..., 0]
        in_front, behind = along.min(axis=1), -along.max(axis=1)
        distance = np.maximum(
            np.maximum(in_front, behind) - np.abs(normals) @ viewpoints.half_extent, 0.0
        )
        cosine = (normals @ viewpoints.axis_rotation[2]) * np.where(in_front >= behind, 1.0, -1.0)
        return np.maximum(to_box, plane_distance_bounds(distance, cosine, rings))


def _child_indices(nodes: Indices, count: int) -> Indices:
    """Return what of `count` things below belongs to nodes."""
    below = (nodes[:, None] * _BRANCHING + np.arange(_BRANCHING)).ravel()
    return below[below < count]
