"""How near a set of triangles comes in each ring of the image: a tree of boxes, asked as one.

Triangles that lie together share a box, boxes that lie together a larger one. A question is asked
for all viewpoints of a box at once, so that its answer can be kept. What a triangle is asked is
its own box, turned with the mirror's axis, and its own plane. What hides what is not asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.scene_summary import RINGS
from catoptra_server.render.chunks import make_chunks
from catoptra_server.render.rings import Rings, box_bounds, plane_bounds

Indices = npt.NDArray[np.intp]

# So many triangles a box, and boxes a larger box.
_FAN = 32
# What is farther than this share of the nearest known is not looked at more closely.
_CLOSE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """A box of viewpoints that share an axis, in the triangles' frame.

    middle, half: (3,) of the box. turn: (3, 3) to axes whose z is the mirror's axis.
    """

    middle: Floats
    half: Floats
    turn: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """(n, 3) middles and halves of boxes."""

    middle: Floats
    half: Floats

    def bounds(self, some: Indices, seen: Viewpoints, rings: Rings) -> Floats:
        """Return the (m, RINGS) bounds of some of them."""
        middle = (self.middle[some] - seen.middle) @ seen.turn.T
        half = (self.half[some] + seen.half) @ np.abs(seen.turn).T
        return box_bounds(middle - half, middle + half, rings)


class Nearness:
    """Triangles that can be asked how near they come: (n, 3, 3) corners and (n, 3) normals."""

    def __init__(self, corners: Floats, normals: Floats) -> None:
        chunks = make_chunks(corners, np.zeros(len(corners), dtype=np.intp), size=_FAN)
        self._corners = corners
        self._normals = normals
        self._order = chunks.order
        low, high = chunks.low, chunks.high
        self._levels: list[_Boxes] = []  # from small to large
        while len(low):
            self._levels.append(_Boxes(0.5 * (low + high), 0.5 * (high - low)))
            if len(low) <= _FAN:
                break
            first = np.arange(0, len(low), _FAN)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)

    def bounds(self, seen: Viewpoints, rings: Rings) -> Floats:
        """Return (RINGS,) distances within which no ring shows a triangle; inf where none is."""
        if not self._levels:
            return np.full(RINGS, np.inf)
        nearest = self._some_triangles(seen, rings)
        passed_over = np.full(RINGS, np.inf)
        nodes = self._roots
        for level, below in self._downwards:
            bounds = self._levels[level].bounds(nodes, seen, rings)
            is_needed = (bounds < _CLOSE * nearest).any(axis=1)
            passed_over = np.minimum(passed_over, bounds[~is_needed].min(axis=0, initial=np.inf))
            nodes = _children(nodes[is_needed], below)
        asked = self._triangle_bounds(nodes, seen, rings).min(axis=0, initial=np.inf)
        nearest = np.minimum(np.minimum(nearest, asked), passed_over)
        return nearest

    def boxes(self, seen: Viewpoints, rings: Rings) -> Floats:
        """Return the same from the smallest boxes alone: cheaper, and less."""
        if not self._levels:
            return np.full(RINGS, np.inf)
        boxes = self._levels[0]
        bounds: Floats = boxes.bounds(np.arange(len(boxes.half)), seen, rings).min(axis=0)
        return bounds

    def _some_triangles(self, seen: Viewpoints, rings: Rings) -> Floats:
        """Return (RINGS,) bounds of those triangles that lie in the nearest boxes of each ring."""
        nodes = self._roots
        for level, below in self._downwards:
            bounds = self._levels[level].bounds(nodes, seen, rings)
            nodes = _children(nodes[np.unique(bounds.argmin(axis=0))], below)
        nearest: Floats = self._triangle_bounds(nodes, seen, rings).min(axis=0)
        return nearest

    @property
    def _roots(self) -> Indices:
        return np.arange(len(self._levels[-1].half))

    @property
    def _downwards(self) -> list[tuple[int, int]]:
        """Return the levels from the largest boxes on, each with how many there are below it."""
        counts = [len(self._order), *(len(boxes.half) for boxes in self._levels)]
        return [(level, counts[level]) for level in reversed(range(len(self._levels)))]

    def _triangle_bounds(self, places: Indices, seen: Viewpoints, rings: Rings) -> Floats:
        """Return the (m, RINGS) bounds of the triangles at (m,) places of the order.

        Corners lie behind a plane, and so does what is between them: this holds for any normal,
        so that of a triangle without area does no harm.
        """
        some = self._order[places]
        corners, normals = self._corners[some] - seen.middle, self._normals[some]
        turned = corners @ seen.turn.T
        half = np.abs(seen.turn) @ seen.half
        to_box = box_bounds(turned.min(axis=1) - half, turned.max(axis=1) + half, rings)
        along = (corners @ normals[:, :, None])[..., 0]
        in_front, behind = along.min(axis=1), -along.max(axis=1)
        distance = np.maximum(np.maximum(in_front, behind) - np.abs(normals) @ seen.half, 0.0)
        cosine = (normals @ seen.turn[2]) * np.where(in_front >= behind, 1.0, -1.0)
        return np.maximum(to_box, plane_bounds(distance, cosine, rings))


def _children(nodes: Indices, count: int) -> Indices:
    """Return what of `count` things below belongs to nodes."""
    below = (nodes[:, None] * _FAN + np.arange(_FAN)).ravel()
    return below[below < count]
