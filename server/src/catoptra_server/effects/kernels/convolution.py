"""Convolution with kernels that are symmetric about both axes and both diagonals; kernels of discs.

A symmetric kernel has one weight for each pair i >= j >= 0 of offsets in columns and rows: the
pixels at (+-i, +-j) and (+-j, +-i) share a weight and are summed before the product. Weights may
differ from pixel to pixel. Outside the image the border pixel is repeated.

A uniform disc has a kernel by its variance. A pixel is already the mean over its square, so a disc
is laid over squares of constant radiance: a pixel's weight is the fraction of the disc's area in
that pixel. The squares add a spread of their own, 1/12 px^2 for large discs; the laid disc is
therefore smaller than the intended one, such that the kernel's variance along each axis is exactly
d^2 / 16, as of the intended disc. A disc within its pixel would have no effect; by the variance the
four neighbours still receive light. Weights are 0 or more and sum to 1: no light is lost, nothing
overshoots. The linear mixture of two rows of the table keeps sum and variance exact. Source:
derived here; the area is the integral of the circle's ordinate, cut at the square's sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arcsin, interpolate_linear, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import Real

# Weights of a strip of rows: (pairs, rows, w) or, the same for all pixels, (pairs, 3, 1, 1).
_KernelRowWeights = Callable[[slice], npt.NDArray[Real]]


def convolve_symmetric(
    image: npt.NDArray[Real], half_width_px: int, kernel_row_weights: _KernelRowWeights[Real]
) -> npt.NDArray[Real]:
    """Convolve a (h, w, c) image.

    Args:
        image: Linear radiance.
        half_width_px: Half the kernel's width without the central pixel.
        kernel_row_weights: Weights of the pixels in a slice of rows.

    Returns:
        A new array of the image's type.
    """
    result = np.zeros_like(image)
    for rows, total in _weighted_sums(np.moveaxis(image, -1, 0), half_width_px, kernel_row_weights):
        result[rows] = np.moveaxis(total, 0, -1)
    return result


def convolve_symmetric_within(
    image: npt.NDArray[Real],
    mask: Bools,
    half_width_px: int,
    kernel_row_weights: _KernelRowWeights[Real],
) -> npt.NDArray[Real]:
    """Convolve the pixels of an (h, w) mask with pixels of the mask alone.

    Weights that fall outside the mask go to the central pixel: a uniform region stays uniform up to
    its edge. Pixels outside the mask do not change. Domain: kernels that sum to 1.
    """
    result = image.copy()
    centre = np.moveaxis(image, -1, 0)
    # The mask is convolved as a fourth plane: 1 minus that is the weight that fell outside.
    planes = np.concatenate((np.where(mask, centre, 0), mask[None])).astype(image.dtype)
    for rows, total in _weighted_sums(planes, half_width_px, kernel_row_weights):
        blurred = total[:3] + (1 - total[3]) * centre[:, rows]
        result[rows] = np.moveaxis(np.where(mask[rows], blurred, centre[:, rows]), 0, -1)
    return result


def offset_pairs(half_width_px: int) -> Iterator[tuple[int, int]]:
    """Pairs (i, j) in the order of their weights: index i (i + 1) / 2 + j."""
    # Sorted by i, so a narrower kernel's weights are a prefix of a wider one's.
    return ((i, j) for i in range(half_width_px + 1) for j in range(i + 1))


def _num_offset_pairs(half_width_px: int) -> int:
    """Number of weights of a kernel of (2 half_width_px + 1)^2 pixels."""
    return (half_width_px + 1) * (half_width_px + 2) // 2


def pair_multiplicities(half_width_px: int) -> Floats:
    """Number of pixels that share each weight: 1, 4 or 8."""
    # 4 on the axes (j = 0) and on the diagonals (j = i), 8 between.
    sizes = [1 if i == 0 else 4 if j in (0, i) else 8 for i, j in offset_pairs(half_width_px)]
    return np.array(sizes, dtype=np.float64)


# Rows per strip: the sums of a strip stay in the processor's cache.
_ROWS_PER_STRIP = 32


def _weighted_sums(
    planes: npt.NDArray[Real], half_width_px: int, kernel_row_weights: _KernelRowWeights[Real]
) -> Iterator[tuple[slice, npt.NDArray[Real]]]:
    """Weighted sums, (c, rows, w), of (c, h, w) planes, strip by strip."""
    count, height, width = planes.shape
    planes = np.pad(planes, ((0, 0), (half_width_px,) * 2, (half_width_px,) * 2), "edge")
    for top in range(0, height, _ROWS_PER_STRIP):
        rows = slice(top, min(top + _ROWS_PER_STRIP, height))
        strip = planes[:, top : rows.stop + 2 * half_width_px]
        sums = _pair_sums(strip, half_width_px, rows.stop - top, width)
        total = np.zeros((count, rows.stop - top, width), dtype=planes.dtype)
        for pair_sum, weight in zip(sums, kernel_row_weights(rows), strict=True):
            total += weight * pair_sum
        yield rows, total


def _pair_sums(
    strip: npt.NDArray[Real], half_width_px: int, height: int, width: int
) -> Iterator[npt.NDArray[Real]]:
    """Sums, (c, height, width), of the pixels of each pair."""
    # Column sums are used by every pair with that offset: computed once, summed over rows below.
    horizontal = [
        _sum_of_shifts(strip, i, half_width_px, width, axis=2) for i in range(half_width_px + 1)
    ]
    for i, j in offset_pairs(half_width_px):
        total = _sum_of_shifts(horizontal[j], i, half_width_px, height, axis=1)
        if i != j:
            total = total + _sum_of_shifts(horizontal[i], j, half_width_px, height, axis=1)
        yield total


def _sum_of_shifts(
    planes: npt.NDArray[Real], step: int, half_width_px: int, length: int, *, axis: int
) -> npt.NDArray[Real]:
    """Sum of the planes shifted by `step` and by -`step`; step 0: the planes once."""
    before, behind = (
        planes[(slice(None),) * axis + (slice(half_width_px + at, half_width_px + at + length),)]
        for at in (-step, step)
    )
    return before if step == 0 else before + behind


MAX_DIAMETER_PX = 32.0
"""Widest disc that is drawn; a wider one is drawn as this: tables grow with the fourth power."""
# Rows of the table per px^2 of variance; a kink of a weight between two rows is cut by 1e-4.
_ROWS_PER_PX2 = 64
# Step of the laid disc's diameter; the table's variances are interpolated between these steps.
_DIAMETER_STEP_PX = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class DiscKernelTable:
    """Weights of symmetric kernels of growing variance."""

    half_width_px: int
    """Half width of the widest kernel, without the central pixel."""
    weights: Floats
    """(rows, pairs); row n has a variance of n / _ROWS_PER_PX2."""

    def half_width_up_to_row(self, row: float) -> int:
        """Half width of the widest kernel up to a row."""
        return _half_width(self.weights[: math.ceil(row) + 1], self.half_width_px)

    def interpolate(self, row: npt.NDArray[Real], half_width_px: int) -> npt.NDArray[Real]:
        """Weights, (pairs, ...), of (...) fractional rows, up to a half width."""
        row = np.minimum(row, row.dtype.type(len(self.weights) - 1))
        below = np.minimum(row.astype(np.intp), len(self.weights) - 2)
        fraction = row - below.astype(row.dtype)
        # The pairs of a narrower kernel are the first ones of a wider kernel.
        weights = self.weights[:, : _num_offset_pairs(half_width_px)].T.astype(row.dtype)
        steps = np.diff(weights, axis=1)
        mixed = np.zeros((len(weights), *row.shape), dtype=row.dtype)
        for pair, (lower, step) in enumerate(zip(weights, steps, strict=True)):
            mixed[pair] = lower.take(below) + fraction * step.take(below)
        return mixed

    def max_exchange(self, one_px: float, other_px: float) -> float:
        """Largest fraction of light that two discs, or any between, give to different pixels.

        Half the sum of |w - w'| over all pixels, at most; by the steps between the rows of the
        table, over which weights are linear.

        Args:
            one_px: Diameter of a disc; 0 for a point, which stays in its pixel.
            other_px: Diameter of the other disc.
        """
        rows = table_row(np.array((one_px, other_px)))
        exchanges = _summed_exchanges(self)
        between = interpolate_linear(rows, np.arange(float(len(exchanges))), exchanges)
        return min(1.0, abs(float(between[1] - between[0])))

    @property
    def max_step(self) -> float:
        """Largest such fraction between neighbouring rows."""
        return float(np.diff(_summed_exchanges(self)).max())


def table_row(diameter_px: Floats) -> Floats:
    """Fractional row of the kernel of a disc."""
    # The variance of a disc along an axis is d^2 / 16.
    row: Floats = (_ROWS_PER_PX2 / 16.0) * np.square(diameter_px)
    return row


@lru_cache(maxsize=8)
def disc_kernel_table(max_diameter_px: float) -> DiscKernelTable:
    """Kernels of all discs up to a diameter, at most MAX_DIAMETER_PX."""
    max_diameter_px = min(max_diameter_px, MAX_DIAMETER_PX)
    rows = math.ceil(float(table_row(np.array(max_diameter_px)))) + 2
    variance = np.arange(rows) / _ROWS_PER_PX2
    # A laid disc of 1 px has no variance; one of max_diameter_px + 1 always has more than the
    # intended one: between both lie all variances of the table.
    laid_px = np.arange(1.0, max(max_diameter_px, 1.0) + 1.0 + _DIAMETER_STEP_PX, _DIAMETER_STEP_PX)
    half_width = math.ceil(0.5 * laid_px[-1] - 0.5)
    fractions = _disc_area_fractions(laid_px, half_width)
    laid_variance = _variances(fractions, half_width)
    # Inverted by interpolation: the variance grows steadily with the laid diameter.
    weights = np.stack(
        [interpolate_linear(variance, laid_variance, fraction) for fraction in fractions.T], axis=-1
    )
    half_width = _half_width(weights, half_width)
    weights = np.ascontiguousarray(weights[:, : _num_offset_pairs(half_width)])
    weights.setflags(write=False)
    return DiscKernelTable(half_width, weights)


def _half_width(weights: Floats, half_width_px: int) -> int:
    """Largest offset with a weight above 0 in any of (rows, pairs) weights."""
    return max(
        i
        for (i, _), column in zip(offset_pairs(half_width_px), weights.T, strict=True)
        if column.any()
    )


@lru_cache(maxsize=8)
def _summed_exchanges(table: DiscKernelTable) -> Floats:
    """Half the sums of |w - w'| between neighbouring rows, summed from row 0, (rows,)."""
    multiplicities = pair_multiplicities(table.half_width_px)
    steps = 0.5 * matmul(np.abs(np.diff(table.weights, axis=0)), multiplicities)
    return np.concatenate(([0.0], np.cumsum(steps)))


@lru_cache(maxsize=8)
def float32_weights(table: DiscKernelTable) -> npt.NDArray[np.float32]:
    """Weights for the kernel's stage, (rows, pairs), the same array in each call."""
    return table.weights.astype(np.float32)


def _disc_area_fractions(diameter_px: Floats, half_width_px: int) -> Floats:
    """Fractions, (n, pairs), of the areas of n discs that lie in one pixel of each pair."""
    radius = 0.5 * np.asarray(diameter_px)[:, None]
    i, j = np.array(list(offset_pairs(half_width_px))).T.astype(np.float64)
    # Inclusion and exclusion of the areas up to the pixel's four corners.
    corners = [
        sign * _corner_area(i + dx, j + dy, radius)
        for dx, dy, sign in ((0.5, 0.5, 1), (-0.5, 0.5, -1), (0.5, -0.5, -1), (-0.5, -0.5, 1))
    ]
    area: Floats = sum(corners, start=np.zeros(1)) / (math.pi * np.square(radius))
    # Where all four areas are the whole quadrant their difference is rounding; kept, a kernel
    # would have the half width of the table everywhere.
    return np.where(area > 1e-12, area, 0.0)


def _corner_area(x: Floats, y: Floats, radius: Floats) -> Floats:
    """Area of a disc between the axes and (x, y), odd in both."""
    sign = np.sign(x) * np.sign(y)
    x, y = np.minimum(np.abs(x), radius), np.minimum(np.abs(y), radius)
    # Up to this abscissa the circle lies above y: a rectangle, and beyond a piece of the circle.
    flat = np.minimum(np.sqrt(np.square(radius) - np.square(y)), x)
    area: Floats = y * flat + _circle_integral(x, radius) - _circle_integral(flat, radius)
    return sign * area


def _circle_integral(x: Floats, radius: Floats) -> Floats:
    """Integral of the circle's ordinate from 0 to x."""
    chord = np.sqrt(np.maximum(np.square(radius) - np.square(x), 0.0))
    area: Floats = 0.5 * (x * chord + np.square(radius) * arcsin(np.minimum(x / radius, 1.0)))
    return area


def _variances(weights: Floats, half_width_px: int) -> Floats:
    """Variances along an axis, (n,), px^2, of kernels of (n, pairs) weights."""
    squares = np.array([0.5 * (i * i + j * j) for i, j in offset_pairs(half_width_px)])
    variances: Floats = matmul(weights, squares * pair_multiplicities(half_width_px))
    return variances
