"""Nodes of surfaces' grids that something could occlude: those near boxes around the casters."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.occlusion.grid_layout import GridLayout, SurfaceFrames
from catoptra_server.world.triangles import make_clusters

Numbers = npt.NDArray[np.intp]

# What rises less over a plane occludes nothing of it: markings lie on floors, posters on walls.
MIN_HEIGHT_M = 0.005
# Boxes in all, at least; a scene of few triangles has one each.
_NUM_BOXES = 500
_SURFACES_AT_ONCE = 256


@dataclass(frozen=True, slots=True, eq=False)
class CasterBoxes:
    """Boxes around all triangles that occlude light."""

    centre: Floats
    """(b, 3) metres."""
    half: Floats
    """(b, 3) half sizes."""

    def take(self, boxes: Numbers) -> CasterBoxes:
        """Rows of some boxes."""
        return CasterBoxes(self.centre[boxes], self.half[boxes])


def enclose_casters(corners: Floats) -> CasterBoxes:
    """Boxes around (n, 3, 3) triangles: neighbours of like size share one."""
    longest = np.ptp(corners, axis=1).max(axis=-1, initial=0.0)
    # A floor shares no box with a crate on it.
    size_class = np.log2(np.maximum(longest, 1e-3) * 1e3).astype(np.intp)
    clusters = make_clusters(corners, size_class, size=max(1, len(corners) // _NUM_BOXES))
    return CasterBoxes(
        0.5 * (clusters.box_min + clusters.box_max), 0.5 * (clusters.box_max - clusters.box_min)
    )


@dataclass(frozen=True, slots=True, eq=False)
class NearPairs:
    """Surfaces, and boxes of casters near them."""

    surface: Numbers
    """(p,) surface of each pair."""
    frames: SurfaceFrames
    """Its coordinate system."""
    boxes: CasterBoxes
    """The box of each pair."""
    radius_m: float
    """Farther nodes are not near."""

    def find_nodes(self, layout: GridLayout) -> Bools:
        """(h, w) nodes of an atlas that have a box within the radius."""
        x0, x1 = self._find_span(self.frames, layout.columns[self.surface])
        y0, y1 = self._find_span(self.frames.transpose(), layout.rows[self.surface])
        is_met = (x0 < x1) & (y0 < y1)
        left, top = layout.left[self.surface], layout.top[self.surface]
        x0, x1, y0, y1 = (a[is_met] for a in (left + x0, left + x1, top + y0, top + y1))
        # Corners of rectangles, summed along both axes, count the rectangles over each node.
        count = np.zeros((layout.height + 1, layout.width + 1), dtype=np.int32)
        for rows, columns, sign in ((y0, x0, 1), (y0, x1, -1), (y1, x0, -1), (y1, x1, 1)):
            np.add.at(count, (rows, columns), sign)
        near: Bools = count.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
        return near

    def _find_span(
        self, frames: SurfaceFrames, num_nodes: npt.NDArray[np.int32]
    ) -> tuple[Numbers, Numbers]:
        """First node along side x within the radius of each box, and the one after the last."""
        length = np.linalg.norm(frames.side_x, axis=-1)
        axis = frames.side_x / length[:, None]
        centre = np.einsum("pi,pi->p", self.boxes.centre - frames.origin, axis)
        half = np.einsum("pi,pi->p", self.boxes.half, np.abs(axis)) + self.radius_m
        # The sides of small triangles' grids enclose any angle.
        half += np.abs(np.einsum("pi,pi->p", frames.side_y, axis))
        step = length / (num_nodes - 1)
        # Whole steps outward: bilinear interpolation reaches there.
        first = np.floor((centre - half) / step).astype(np.intp)
        last = np.ceil((centre + half) / step).astype(np.intp)
        return np.maximum(first, 0), np.minimum(last + 1, num_nodes)


def find_near_pairs(frames: SurfaceFrames, boxes: CasterBoxes, radius_m: float) -> NearPairs:
    """Boxes that reach before the planes of surfaces and near their rectangles."""
    middle = frames.origin + 0.5 * (frames.side_x + frames.side_y)
    diagonals = np.stack((frames.side_x + frames.side_y, frames.side_x - frames.side_y))
    limit = 0.5 * np.linalg.norm(diagonals, axis=-1).max(axis=0) + radius_m
    pairs = []
    for first in range(0, len(middle), _SURFACES_AT_ONCE):
        part = slice(first, first + _SURFACES_AT_ONCE)
        offset = boxes.centre - middle[part, None]
        outside = np.maximum(np.abs(offset) - boxes.half, 0.0)
        near = np.einsum("mbi,mbi->mb", outside, outside) < limit[part, None] ** 2
        height = np.einsum("mbi,mi->mb", offset, frames.normal[part])
        reach = np.abs(frames.normal[part]) @ boxes.half.T
        near &= (height + reach > MIN_HEIGHT_M) & (height - reach < radius_m)
        surface, box = np.nonzero(near)
        pairs.append((surface + first, box))
    surface, box = (np.concatenate(found) for found in zip(*pairs, strict=True))
    return NearPairs(surface, frames.take_rows(surface), boxes.take(box), radius_m)
