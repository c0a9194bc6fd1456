"""The image of an omnidirectional camera as square cells, and the rays of each.

The rays at a cell's four corners decide whether the cell may be filled; the samples inside lie
within the pyramid that these four span. (A cell's border is bent by the camera model: n px of it
stray from the chord by less than n^2 / 8 R with R the radius of the bend, which is of the order of
the image's: 0.01 px at 4 px. No sample is nearer to a border than half a sample's pitch, 0.03 px at
16 x 16.)
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
    """Cells of side_px x side_px pixels, `rows` x `columns`, numbered row by row."""

    side_px: int
    """Pixels along a cell's side."""
    rows: int
    """Rows of cells."""
    columns: int
    """Columns of cells."""
    nodes: npt.NDArray[np.intp]
    """(v,) indices, among (rows + 1) * (columns + 1), of the nodes on the mirror."""
    node_rays: Float32s
    """(v, 3) directions through these nodes."""
    row_of: npt.NDArray[np.intp]
    """(rows * columns,) row of each cell in the tables below, -1 unless wholly on the mirror."""
    directions: Float32s
    """(c, side^2 * samples_per_pixel, 3) directions of each cell's rays."""
    pixels: npt.NDArray[np.intp]
    """(c, side^2) flat pixel indices."""
    cone_axes: Float32s
    """(c, 3) axis of a cone around each cell."""
    reach_rad: Floats
    """(c,) half angle of a cone around each cell."""
    others: RaySamples
    """Rays of pixels in no such cell, always traced."""

    @classmethod
    def from_camera(cls, camera: OmniCamera, samples: RaySamples, *, side_px: int) -> CellGrid:
        """Cells of a camera's rays."""
        rows, columns = camera.height_px // side_px, camera.width_px // side_px
        v, u = np.mgrid[: rows + 1, : columns + 1] * float(side_px)
        corners, valid = direction_from_pixel(camera, np.stack((u, v), axis=-1))
        inside = valid[:-1, :-1] & valid[1:, :-1] & valid[:-1, 1:] & valid[1:, 1:]
        cells = np.flatnonzero(inside)
        pixels = _pixels_of(cells, columns, side_px, samples.width_px)
        cone_axes, reach = _cones(corners, cells, columns)
        # A cell wholly on the mirror has rays for all its pixels, so every look-up below succeeds.
        sample_of_pixel = np.full(samples.width_px * samples.height_px, -1)
        sample_of_pixel[samples.pixels] = np.arange(len(samples.pixels))
        is_other = np.ones(len(samples.pixels), dtype=bool)
        is_other[sample_of_pixel[pixels]] = False
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
            directions=rays[sample_of_pixel[pixels]].reshape(
                len(cells), side_px**2 * samples.samples_per_pixel, 3
            ),
            pixels=pixels,
            cone_axes=cone_axes.astype(np.float32),
            reach_rad=reach,
            others=samples.select(is_other),
        )

    @property
    def memory_bytes(self) -> int:
        """Size of the arrays."""
        arrays = (
            self.nodes,
            self.node_rays,
            self.row_of,
            self.directions,
            self.pixels,
            self.cone_axes,
            self.reach_rad,
        )
        return sum(array.nbytes for array in arrays) + self.others.memory_bytes

    def has_equal_nodes(self, at_nodes: npt.NDArray[np.int32]) -> Bools:
        """(rows * columns,) whether a cell's four nodes have equal values."""
        at = at_nodes.reshape(self.rows + 1, self.columns + 1)
        across = at[:, 1:] == at[:, :-1]
        down = at[1:, :-1] == at[:-1, :-1]
        agree: Bools = (across[1:] & across[:-1] & down).reshape(-1)
        return agree

    def first_node(self, at_nodes: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """(rows * columns,) value at each cell's upper left node."""
        at = at_nodes.reshape(self.rows + 1, self.columns + 1)
        return at[:-1, :-1].reshape(-1)


def _pixels_of(
    cells: npt.NDArray[np.intp], columns: int, side_px: int, width_px: int
) -> npt.NDArray[np.intp]:
    """(c, side^2) flat pixel indices of cells."""
    row, column = np.divmod(cells, columns)
    v, u = np.divmod(np.arange(side_px * side_px), side_px)
    above = (row[:, None] * side_px + v) * width_px
    flat: npt.NDArray[np.intp] = above + column[:, None] * side_px + u
    return flat


def _cones(corners: Floats, cells: npt.NDArray[np.intp], columns: int) -> tuple[Floats, Floats]:
    """(c, 3) axes of cells and the (c,) angles to their farthest corners."""
    row, column = np.divmod(cells, columns)
    four = np.stack([corners[row + i, column + j] for i in (0, 1) for j in (0, 1)], axis=1)
    axes = four.sum(axis=1)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    chord = np.linalg.norm(four - axes[:, None], axis=-1).max(axis=-1, initial=0.0)
    return axes, 2.0 * np.arcsin(0.5 * chord)
