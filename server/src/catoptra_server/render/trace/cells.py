"""The picture of a mirror camera as square cells: which can be filled, and the rays of the others.

A cell's rays at its four corners decide whether it may be filled; the samples inside lie within the
pyramid that these four span. (A cell's border is bent by the law: n px of it stray from the chord
by less than n^2 / 8 R with R the radius of the bend, which is of the order of the image's: 0.01 px
at 4 px. No sample is nearer to a border than half a sample's pitch, 0.03 px at 16 x 16.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.render.trace.ray_samples import RaySamples


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """Cells of side_px x side_px pixels, `rows` x `columns`, numbered row by row.

    node_rays: (v, 3) directions through the corners of cells, nodes: (v,) which of the (rows + 1) *
    (columns + 1) they are: those on the mirror. row_of: (rows * columns,) the cell's row in the
    tables below, -1 for cells not wholly on the mirror. directions: (c, side^2 * per_pixel, 3),
    pixels: (c, side^2) flat indices. middle: (c, 3), cosine (c,): a cone around each.
    others: the rays of pixels in no such cell, always traced.
    """

    side_px: int
    rows: int
    columns: int
    nodes: npt.NDArray[np.intp]
    node_rays: Float32s
    row_of: npt.NDArray[np.intp]
    directions: Float32s
    pixels: npt.NDArray[np.intp]
    middle: Float32s
    reach_rad: Floats
    others: RaySamples

    @classmethod
    def from_camera(cls, camera: OmniCamera, samples: RaySamples, *, side_px: int) -> CellGrid:
        """Return the cells of a camera's rays."""
        rows, columns = camera.height_px // side_px, camera.width_px // side_px
        v, u = np.mgrid[: rows + 1, : columns + 1] * float(side_px)
        corners, valid = direction_from_pixel(camera, np.stack((u, v), axis=-1))
        inside = valid[:-1, :-1] & valid[1:, :-1] & valid[:-1, 1:] & valid[1:, 1:]
        cells = np.flatnonzero(inside)
        pixels = _pixels_of(cells, columns, side_px, samples.width_px)
        middle, reach = _cones(corners, cells, columns)
        # Cells wholly on the mirror have all their pixels among the samples'.
        place = np.full(samples.width_px * samples.height_px, -1)
        place[samples.pixels] = np.arange(len(samples.pixels))
        rest = np.ones(len(samples.pixels), dtype=bool)
        rest[place[pixels]] = False
        rays = samples.directions.reshape(-1, samples.samples_per_pixel, 3)
        row_of = np.full(rows * columns, -1, dtype=np.intp)
        row_of[cells] = np.arange(len(cells))
        return cls(
            side_px=side_px,
            rows=rows,
            columns=columns,
            nodes=np.flatnonzero(valid),
            node_rays=corners[valid].astype(np.float32),
            row_of=row_of,
            directions=rays[place[pixels]].reshape(
                len(cells), side_px**2 * samples.samples_per_pixel, 3
            ),
            pixels=pixels,
            middle=middle.astype(np.float32),
            reach_rad=reach,
            others=samples.select(rest),
        )

    def has_equal_nodes(self, at_nodes: npt.NDArray[np.int32]) -> Bools:
        """Return (rows * columns,) which cells have equal values at their four nodes."""
        at = at_nodes.reshape(self.rows + 1, self.columns + 1)
        across = at[:, 1:] == at[:, :-1]
        down = at[1:, :-1] == at[:-1, :-1]
        agree: Bools = (across[1:] & across[:-1] & down).reshape(-1)
        return agree

    def first_node(self, at_nodes: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """Return (rows * columns,) each cell's value at its upper left node."""
        at = at_nodes.reshape(self.rows + 1, self.columns + 1)
        return at[:-1, :-1].reshape(-1)


def _pixels_of(
    cells: npt.NDArray[np.intp], columns: int, side_px: int, width_px: int
) -> npt.NDArray[np.intp]:
    """Return the (c, side^2) flat pixel indices of cells."""
    row, column = np.divmod(cells, columns)
    v, u = np.divmod(np.arange(side_px * side_px), side_px)
    above = (row[:, None] * side_px + v) * width_px
    flat: npt.NDArray[np.intp] = above + column[:, None] * side_px + u
    return flat


def _cones(corners: Floats, cells: npt.NDArray[np.intp], columns: int) -> tuple[Floats, Floats]:
    """Return (c, 3) middles of cells and the (c,) angle to their farthest corner."""
    row, column = np.divmod(cells, columns)
    four = np.stack([corners[row + i, column + j] for i in (0, 1) for j in (0, 1)], axis=1)
    middle = four.sum(axis=1)
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    chord = np.linalg.norm(four - middle[:, None], axis=-1).max(axis=-1, initial=0.0)
    return middle, 2.0 * np.arcsin(0.5 * chord)
