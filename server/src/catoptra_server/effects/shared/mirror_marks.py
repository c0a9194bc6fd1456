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

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.shared.mirror_chart import MirrorChart
from catoptra_server.effects.shared.noise import Words, hashed

# More grains than this are drawn as so many larger ones that cover as much.
_MOST_GRAINS = 2**19
_CELLS_PER_PX = 4.0
_WORD = 2.0**32


@dataclass(frozen=True, slots=True)
class Marks:
    """cover: share of the surface under dust. diameter_m: mean of grains. scratches: how many.

    scratch_length_m: their mean. scratch_width_m: of each.
    """

    cover: float
    diameter_m: float
    scratches: int
    scratch_length_m: float
    scratch_width_m: float

    def diameters_m(self, area_m2: float) -> Floats:
        """Return the (n,) diameters of the grains on a surface, the smallest first."""
        covered_m2 = self.cover * area_m2
        # The mean square of an exponential distribution is twice the square of its mean.
        wished = covered_m2 / (0.5 * math.pi * self.diameter_m**2)
        count = min(round(wished) or math.ceil(wished), _MOST_GRAINS)
        sizes = _exponential(count)
        scale = math.sqrt(covered_m2 / (0.25 * math.pi * float(sizes @ sizes))) if count else 0.0
        return scale * sizes

    def lengths_m(self) -> Floats:
        """Return the (n,) lengths of the scratches."""
        return self.scratch_length_m * _exponential(self.scratches)


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """(n,) squares in the picture: their middles, and their sides, up to 1 px."""

    u: Floats
    v: Floats
    side_px: Floats


def coverage(cells: Cells, camera: OmniCamera) -> Floats:
    """Return the (h, w) share of each pixel that squares cover, at most 1; they do not overlap."""
    height, width = camera.height_px, camera.width_px
    covered = np.zeros(height * width)
    half = 0.5 * cells.side_px
    columns, rows = (_parts(middle - half, cells.side_px) for middle in (cells.u, cells.v))
    for column, across in columns:
        for row, down in rows:
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            place = (row * width + column)[inside]
            covered += np.bincount(place, (across * down)[inside], height * width)
    return np.minimum(covered, 1.0).reshape(height, width)


def _parts(start: Floats, length: Floats) -> list[tuple[npt.NDArray[np.intp], Floats]]:
    """Return the two pixels that lengths of up to 1 lie in, and how much of them lies in each."""
    pixel = np.floor(start)
    first = np.minimum(pixel + 1.0 - start, length)
    at = pixel.astype(np.intp)
    return [(at, first), (at + 1, length - first)]


def grain_cells(marks: Marks, camera: OmniCamera, chart: MirrorChart, words: Words) -> Cells:
    """Return the cells of all grains."""
    diameter = marks.diameters_m(chart.area_m2)
    share, turn, _ = _uniform(len(diameter), words)
    radius_px, along, across = chart.at(chart.r_of_share(share))
    cuts = np.ceil(_CELLS_PER_PX * diameter * np.maximum(along, across)).astype(np.intp)
    parts = []
    for cut in np.unique(cuts):
        of = cuts == cut
        x, y = _disc(int(cut))
        size = diameter[of, None]
        out = radius_px[of, None] + size * along[of, None] * x
        aside = size * across[of, None] * y
        cosine, sine = np.cos(2.0 * np.pi * turn[of, None]), np.sin(2.0 * np.pi * turn[of, None])
        area = 0.25 * np.pi * np.square(size) * (along * across)[of, None] / len(x)
        side = np.broadcast_to(np.sqrt(area), out.shape)
        parts.append(np.stack((out * cosine - aside * sine, out * sine + aside * cosine, side)))
    return _cells(parts, camera)


def scratch_cells(marks: Marks, camera: OmniCamera, chart: MirrorChart, words: Words) -> Cells:
    """Return the cells of all scratches; what would lie beyond the rim is left out."""
    lengths = marks.lengths_m()
    share, turn, heading = _uniform(len(lengths), words)
    step_m = 1.0 / (_CELLS_PER_PX * chart.largest_px_per_m)
    rows = math.ceil(marks.scratch_width_m / step_m)
    parts = []
    for middle, length, place, way in zip(
        chart.r_of_share(share), lengths, 2.0 * np.pi * turn, np.pi * heading, strict=True
    ):
        columns = math.ceil(length / step_m)
        along, across = np.meshgrid(
            length * _middles(columns), marks.scratch_width_m * _middles(rows)
        )
        x = middle * np.cos(place) + along * np.cos(way) - across * np.sin(way)
        y = middle * np.sin(place) + along * np.sin(way) + across * np.cos(way)
        cell_m2 = length * marks.scratch_width_m / (columns * rows)
        parts.append(_in_the_picture(x.ravel(), y.ravel(), cell_m2, chart))
    return _cells(parts, camera)


def _in_the_picture(x: Floats, y: Floats, cell_m2: float, chart: MirrorChart) -> Floats:
    """Return (3, n) u and v about the axis, and side, of cells at places in plan."""
    r = np.hypot(x, y)
    x, y, r = (values[r <= chart.r_m[-1]] for values in (x, y, r))
    _, _, across = chart.at(r)
    outward = np.interp(r, chart.r_m, chart.outward)
    return np.stack((across * x, across * y, np.sqrt(cell_m2 * outward * across)))


def _cells(parts: list[Floats], camera: OmniCamera) -> Cells:
    joined = [part.reshape(3, -1) for part in (np.zeros((3, 0)), *parts)]
    u, v, side = np.concatenate(joined, axis=1)
    return Cells(u + camera.centre_px[0], v + camera.centre_px[1], side)


def _disc(cut: int) -> tuple[Floats, Floats]:
    """Return the middles of those of cut x cut cells that lie in a disc of diameter 1."""
    y, x = np.meshgrid(_middles(cut), _middles(cut))
    inside = np.hypot(x, y) <= 0.5
    return x[inside], y[inside]


def _middles(count: int) -> Floats:
    """Return the middles of equal parts of the length from -1/2 to 1/2."""
    return (np.arange(count) + 0.5) / max(count, 1) - 0.5


def _exponential(count: int) -> Floats:
    """Return the middle quantiles of the exponential distribution of mean 1."""
    quantile = (np.arange(count) + 0.5) / max(count, 1)
    return -np.log1p(-quantile)


def _uniform(count: int, words: Words) -> tuple[Floats, Floats, Floats]:
    """Return three times (count,) numbers from 0 to 1, the same for the same words."""
    index = np.arange(count, dtype=np.uint32)
    drawn = hashed(index + words[0], words[1:2], words[2:])
    first, second, third = ((word.astype(np.float64) + 0.5) / _WORD for word in drawn)
    return first, second, third
