"""Dust and scratches on a mirror: where they lie, and what share of each pixel they cover.

Grains are discs, their diameters spread exponentially (an assumption), all over the surface alike;
scratches are straight, long and wide in plan, their lengths spread likewise. Sizes are the middle
quantiles of their distribution, so that all cameras have equal ones and the covered share is exact;
places are drawn, by the camera's key. Marks are cut into cells of at most a quarter pixel; each
covers what a square of its area does. Not simulated: that a grain stands off the surface, and is
seen twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.kernels.mirror_surface_table import MirrorSurfaceTable
from catoptra_server.effects.kernels.noise import UInt32Array, pcg3d

# More grains than this are drawn as so many larger ones that cover as much.
_MAX_PARTICLES = 2**19
_CELLS_PER_PX = 4.0
_WORD_RANGE = 2.0**32


@dataclass(frozen=True, slots=True)
class Contaminants:
    """cover: share of the surface under dust. diameter_m: mean of grains. scratches: how many.

    mean_scratch_length_m: their mean. scratch_width_m: of each.
    """

    coverage: float
    mean_particle_diameter_m: float
    num_scratches: int
    mean_scratch_length_m: float
    scratch_width_m: float

    def particle_diameters_m(self, area_m2: float) -> Floats:
        """Return the (n,) diameters of the grains on a surface, the smallest first."""
        covered_m2 = self.coverage * area_m2
        # The mean square of an exponential distribution is twice the square of its mean.
        wished = covered_m2 / (0.5 * math.pi * self.mean_particle_diameter_m**2)
        count = min(round(wished) or math.ceil(wished), _MAX_PARTICLES)
        sizes = _exponential_quantiles(count)
        scale = math.sqrt(covered_m2 / (0.25 * math.pi * float(sizes @ sizes))) if count else 0.0
        return scale * sizes

    def scratch_lengths_m(self) -> Floats:
        """Return the (n,) lengths of the scratches."""
        return self.mean_scratch_length_m * _exponential_quantiles(self.num_scratches)


@dataclass(frozen=True, slots=True, eq=False)
class ContaminantCells:
    """(n,) squares in the picture: their middles, and their sides, up to 1 px."""

    u: Floats
    v: Floats
    side_px: Floats


def pixel_coverage(cells: ContaminantCells, camera: OmniCamera) -> Floats:
    """Return the (h, w) share of each pixel that squares cover, at most 1; they do not overlap."""
    height, width = camera.height_px, camera.width_px
    covered = np.zeros(height * width)
    half = 0.5 * cells.side_px
    columns, rows = (
        _split_between_pixels(middle - half, cells.side_px) for middle in (cells.u, cells.v)
    )
    for column, across in columns:
        for row, down in rows:
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            place = (row * width + column)[inside]
            covered += np.bincount(place, (across * down)[inside], height * width)
    return np.minimum(covered, 1.0).reshape(height, width)


def _split_between_pixels(
    start: Floats, length: Floats
) -> list[tuple[npt.NDArray[np.intp], Floats]]:
    """Return the two pixels that lengths of up to 1 lie in, and how much of them lies in each."""
    pixel = np.floor(start)
    first = np.minimum(pixel + 1.0 - start, length)
    at = pixel.astype(np.intp)
    return [(at, first), (at + 1, length - first)]


def particle_cells(
    contaminants: Contaminants,
    camera: OmniCamera,
    surface_table: MirrorSurfaceTable,
    key: UInt32Array,
) -> ContaminantCells:
    """Return the cells of all grains."""
    diameter = contaminants.particle_diameters_m(surface_table.area_m2)
    share, turn, _ = _uniform_variates(len(diameter), key)
    radius_px, along, across = surface_table.interpolate(surface_table.r_from_area_fraction(share))
    cuts = np.ceil(_CELLS_PER_PX * diameter * np.maximum(along, across)).astype(np.intp)
    parts = []
    for cut in np.unique(cuts):
        of = cuts == cut
        x, y = _disc_cell_centres(int(cut))
        size = diameter[of, None]
        out = radius_px[of, None] + size * along[of, None] * x
        aside = size * across[of, None] * y
        cosine, sine = np.cos(2.0 * np.pi * turn[of, None]), np.sin(2.0 * np.pi * turn[of, None])
        area = 0.25 * np.pi * np.square(size) * (along * across)[of, None] / len(x)
        side = np.broadcast_to(np.sqrt(area), out.shape)
        parts.append(np.stack((out * cosine - aside * sine, out * sine + aside * cosine, side)))
    return _join_cells(parts, camera)


def scratch_cells(
    contaminants: Contaminants,
    camera: OmniCamera,
    surface_table: MirrorSurfaceTable,
    key: UInt32Array,
) -> ContaminantCells:
    """Return the cells of all scratches; what would lie beyond the rim is left out."""
    lengths = contaminants.scratch_lengths_m()
    share, turn, heading = _uniform_variates(len(lengths), key)
    step_m = 1.0 / (_CELLS_PER_PX * surface_table.max_px_per_m)
    rows = math.ceil(contaminants.scratch_width_m / step_m)
    parts = []
    for middle, length, place, way in zip(
        surface_table.r_from_area_fraction(share),
        lengths,
        2.0 * np.pi * turn,
        np.pi * heading,
        strict=True,
    ):
        columns = math.ceil(length / step_m)
        along, across = np.meshgrid(
            length * _cell_centres(columns), contaminants.scratch_width_m * _cell_centres(rows)
        )
        x = middle * np.cos(place) + along * np.cos(way) - across * np.sin(way)
        y = middle * np.sin(place) + along * np.sin(way) + across * np.cos(way)
        cell_m2 = length * contaminants.scratch_width_m / (columns * rows)
        parts.append(_project_cells(x.ravel(), y.ravel(), cell_m2, surface_table))
    return _join_cells(parts, camera)


def _project_cells(
    x: Floats, y: Floats, cell_m2: float, surface_table: MirrorSurfaceTable
) -> Floats:
    """Return (3, n) u and v about the axis, and side, of cells at places in plan."""
    r = np.hypot(x, y)
    x, y, r = (values[r <= surface_table.r_m[-1]] for values in (x, y, r))
    _, _, across = surface_table.interpolate(r)
    outward = np.interp(r, surface_table.r_m, surface_table.plan_radial_px_per_m)
    return np.stack((across * x, across * y, np.sqrt(cell_m2 * outward * across)))


def _join_cells(parts: list[Floats], camera: OmniCamera) -> ContaminantCells:
    joined = [part.reshape(3, -1) for part in (np.zeros((3, 0)), *parts)]
    u, v, side = np.concatenate(joined, axis=1)
    return ContaminantCells(u + camera.centre_px[0], v + camera.centre_px[1], side)


def _disc_cell_centres(cells_per_side: int) -> tuple[Floats, Floats]:
    """Return the middles of those of cut x cut cells that lie in a disc of diameter 1."""
    y, x = np.meshgrid(_cell_centres(cells_per_side), _cell_centres(cells_per_side))
    inside = np.hypot(x, y) <= 0.5
    return x[inside], y[inside]


def _cell_centres(count: int) -> Floats:
    """Return the middles of equal parts of the length from -1/2 to 1/2."""
    return (np.arange(count) + 0.5) / max(count, 1) - 0.5


def _exponential_quantiles(count: int) -> Floats:
    """Return the middle quantiles of the exponential distribution of mean 1."""
    quantile = (np.arange(count) + 0.5) / max(count, 1)
    return -np.log1p(-quantile)


def _uniform_variates(count: int, key: UInt32Array) -> tuple[Floats, Floats, Floats]:
    """Return three times (count,) numbers from 0 to 1, the same for the same words."""
    index = np.arange(count, dtype=np.uint32)
    drawn = pcg3d(index + key[0], key[1:2], key[2:])
    first, second, third = ((word.astype(np.float64) + 0.5) / _WORD_RANGE for word in drawn)
    return first, second, third
