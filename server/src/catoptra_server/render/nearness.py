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
from catoptra_server.effects.scene_summary import RINGS
from catoptra_server.render.chunks import make_chunks
from catoptra_server.render.rings import Rings, box_bounds, plane_bounds

Indices = npt.NDArray[np.intp]

# So many triangles a box, and boxes a larger box.
_FAN = 16
_MOST_AT_TOP = 128
# What is farther than this share of the nearest known is not looked at more closely.
_CLOSE = 0.95
# So many boxes a ring are opened before it is looked again which others have to be.
_AT_ONCE = 8
# A question opens no more boxes when it has asked so many triangles: some 5 ms.
MOST = 2**14


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


@dataclass(frozen=True, slots=True, eq=False)
class _Some:
    """(n,) boxes of a level, and their (n, RINGS) bounds."""

    level: int
    nodes: Indices
    bounds: Floats

    def part(self, which: Bools) -> _Some:
        """Return those of a (n,) mask."""
        return _Some(self.level, self.nodes[which], self.bounds[which])

    def urgent(self, below: Floats) -> tuple[_Some, _Some]:
        """Return what is nearest in any ring, if nearer than (RINGS,) `below`, and the rest."""
        is_urgent = np.ones(len(self.nodes), dtype=bool)
        if len(is_urgent) > _AT_ONCE:
            open_still = np.where(self.bounds < below, self.bounds, np.inf)
            is_urgent[:] = False
            is_urgent[np.argpartition(open_still, _AT_ONCE, axis=0)[:_AT_ONCE]] = True
        return self.part(is_urgent), self.part(~is_urgent)


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
            if len(low) <= _MOST_AT_TOP:
                break
            first = np.arange(0, len(low), _FAN)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)

    def bounds(
        self, seen: Viewpoints, rings: Rings, *, enough: Floats | None = None, most: int = MOST
    ) -> Floats:
        """Return (RINGS,) distances within which no ring shows a triangle; inf where none is.

        enough: (RINGS,); what is not nearer is not looked at more closely. Nothing is, once `most`
        triangles have been asked: then boxes count that hold more than is seen.
        """
        nearest = np.full(RINGS, np.inf) if enough is None else enough / _CLOSE
        found = np.full(RINGS, np.inf)
        waiting = [self._top(seen, rings)] if self._levels else []
        while waiting:
            some = waiting.pop()
            is_needed = np.asarray((some.bounds < _CLOSE * nearest).any(axis=1) & (most > 0))
            found = np.minimum(found, some.bounds[~is_needed].min(axis=0, initial=np.inf))
            if not is_needed.any():
                continue
            now, later = some.part(is_needed).urgent(_CLOSE * nearest)
            if len(later.nodes):
                waiting.append(later)
            if some.level > 0:
                waiting.append(self._below(now, seen, rings))
                continue
            places = _children(now.nodes, len(self._order))
            found = np.minimum(found, self._triangle_bounds(places, seen, rings).min(axis=0))
            nearest = np.minimum(nearest, found)
            most -= len(places)
        return found

    def _top(self, seen: Viewpoints, rings: Rings) -> _Some:
        nodes = np.arange(len(self._levels[-1].half))
        return _Some(len(self._levels) - 1, nodes, self._levels[-1].bounds(nodes, seen, rings))

    def _below(self, some: _Some, seen: Viewpoints, rings: Rings) -> _Some:
        boxes = self._levels[some.level - 1]
        nodes = _children(some.nodes, len(boxes.half))
        return _Some(some.level - 1, nodes, boxes.bounds(nodes, seen, rings))

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
