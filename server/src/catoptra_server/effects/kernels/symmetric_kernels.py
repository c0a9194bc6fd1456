"""Convolution with kernels that are symmetric about both axes and both diagonals.

Such a kernel has one weight for each pair i >= j >= 0 of offsets in columns and rows: the pixels at
(+-i, +-j) and (+-j, +-i) share a weight and are summed before the product. Weights may differ from
pixel to pixel. Outside the image the border pixel is repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.effect import Real

# Rows per strip: the sums of a strip stay in the processor's cache.
_ROWS_PER_STRIP = 32

# Weights of a strip of rows: (pairs, rows, w) or, the same for all pixels, (pairs, 3, 1, 1).
KernelRowWeights = Callable[[slice], npt.NDArray[Real]]


def num_offset_pairs(half_width_px: int) -> int:
    """Number of weights of a kernel of (2 half_width_px + 1)^2 pixels."""
    return (half_width_px + 1) * (half_width_px + 2) // 2


def offset_pairs(half_width_px: int) -> Iterator[tuple[int, int]]:
    """Pairs (i, j) in the order of their weights: index i (i + 1) / 2 + j."""
    # Sorted by i, so the weights of a narrower kernel are a prefix of those of a wider one.
    return ((i, j) for i in range(half_width_px + 1) for j in range(i + 1))


def pair_multiplicities(half_width_px: int) -> Floats:
    """Number of pixels that share each weight: 1, 4 or 8."""
    # 4 on the axes (j = 0) and on the diagonals (j = i), 8 between.
    sizes = [1 if i == 0 else 4 if j in (0, i) else 8 for i, j in offset_pairs(half_width_px)]
    return np.array(sizes, dtype=np.float64)


def convolve_symmetric(
    image: npt.NDArray[Real], half_width_px: int, kernel_row_weights: KernelRowWeights[Real]
) -> npt.NDArray[Real]:
    """Convolve a (h, w, 3) image.

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
    kernel_row_weights: KernelRowWeights[Real],
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


def _weighted_sums(
    planes: npt.NDArray[Real], half_width_px: int, kernel_row_weights: KernelRowWeights[Real]
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
