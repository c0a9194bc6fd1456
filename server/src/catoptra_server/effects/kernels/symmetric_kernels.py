"""Gathers light by kernels that look the same from all four sides and along both diagonals.

Such a kernel has one weight for each pair i >= j >= 0 of distances in columns and rows: the pixels
at (+-i, +-j) and (+-j, +-i) share it, and are summed before they are weighted. Weights may differ
from pixel to pixel. Beyond the border the last pixel's light goes on. Twin:
glsl/include/symmetric_kernels.glsl.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.effect import Real

# Rows that are worked on at a time, so that what is summed stays in the processor's cache.
_ROWS_PER_STRIP = 32

# Of some rows: (pairs, rows, w) or, the same for all pixels of a colour, (pairs, 3, 1, 1).
KernelRowWeights = Callable[[slice], npt.NDArray[Real]]


def num_offset_pairs(half_width_px: int) -> int:
    """Return how many weights a kernel has that reaches so many pixels."""
    return (half_width_px + 1) * (half_width_px + 2) // 2


def offset_pairs(half_width_px: int) -> Iterator[tuple[int, int]]:
    """Return the pairs (i, j) in the order of their weights: index i (i + 1) / 2 + j."""
    return ((i, j) for i in range(half_width_px + 1) for j in range(i + 1))


def pair_multiplicities(half_width_px: int) -> Floats:
    """Return how many pixels share each weight."""
    sizes = [1 if i == 0 else 4 if j in (0, i) else 8 for i, j in offset_pairs(half_width_px)]
    return np.array(sizes, dtype=np.float64)


def convolve_symmetric(
    image: npt.NDArray[Real], half_width_px: int, kernel_row_weights: KernelRowWeights[Real]
) -> npt.NDArray[Real]:
    """Return the (h, w, 3) picture whose pixels are weighted sums of what is around them."""
    result = np.zeros_like(image)
    for rows, total in _weighted_sums(np.moveaxis(image, -1, 0), half_width_px, kernel_row_weights):
        result[rows] = np.moveaxis(total, 0, -1)
    return result


def convolve_symmetric_within(
    image: npt.NDArray[Real],
    mask: Bools,
    half_width_px: int,
    kernel_row_weights: KernelRowWeights[Real],
) -> npt.NDArray[Real]:
    """Return the picture whose pixels inside an (h, w) region gather from within it alone.

    What a kernel would take from outside it takes from its own pixel: an even region stays even up
    to its edge. Outside nothing changes. Domain: kernels that sum to 1.
    """
    result = image.copy()
    own = np.moveaxis(image, -1, 0)
    planes = np.concatenate((np.where(mask, own, 0), mask[None])).astype(image.dtype)
    for rows, total in _weighted_sums(planes, half_width_px, kernel_row_weights):
        changed = total[:3] + (1 - total[3]) * own[:, rows]
        result[rows] = np.moveaxis(np.where(mask[rows], changed, own[:, rows]), 0, -1)
    return result


def _weighted_sums(
    planes: npt.NDArray[Real], half_width_px: int, kernel_row_weights: KernelRowWeights[Real]
) -> Iterator[tuple[slice, npt.NDArray[Real]]]:
    """Return the (c, rows, w) weighted sums of (c, h, w) planes, some rows at a time."""
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
    """Return the (c, height, width) sums of the pixels of each pair."""
    beside = [
        _sum_of_shifts(strip, i, half_width_px, width, axis=2) for i in range(half_width_px + 1)
    ]
    for i, j in offset_pairs(half_width_px):
        total = _sum_of_shifts(beside[j], i, half_width_px, height, axis=1)
        yield (
            total if i == j else total + _sum_of_shifts(beside[i], j, half_width_px, height, axis=1)
        )


def _sum_of_shifts(
    planes: npt.NDArray[Real], step: int, half_width_px: int, length: int, *, axis: int
) -> npt.NDArray[Real]:
    """Return what lies `step` before plus what lies `step` behind; of 0 the pixel itself."""
    before, behind = (
        planes[(slice(None),) * axis + (slice(half_width_px + at, half_width_px + at + length),)]
        for at in (-step, step)
    )
    return before if step == 0 else before + behind
