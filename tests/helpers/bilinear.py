"""Bilinear interpolation between the pixels of an image, in linear radiance.

Pixel centres are at +0.5. Outside the image the nearest border pixel is repeated.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_server.effects import Real

Integers = npt.NDArray[np.signedinteger[Any]]


def sample_bilinear(
    image: npt.NDArray[Real], u: npt.NDArray[Real], v: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    """Radiance, (..., 3), of a (h, w, 3) image at image coordinates (u, v) of any one shape, px."""
    column, row = np.floor(u), np.floor(v)
    half = image.dtype.type(0.5)
    return sample_bilinear_at_offset(
        image,
        column.astype(np.intp),
        row.astype(np.intp),
        offset_u_px=(u - column) - half,
        offset_v_px=(v - row) - half,
    )


def sample_bilinear_at_offset(
    image: npt.NDArray[Real],
    column: Integers,
    row: Integers,
    *,
    offset_u_px: npt.NDArray[Real],
    offset_v_px: npt.NDArray[Real],
) -> npt.NDArray[Real]:
    """Radiance, (..., 3), of an image at offsets from the centres of pixels (column, row)."""
    # Pixel and offset stay apart: their sum would lose the offset's last bits in float32.
    left, above = np.floor(offset_u_px), np.floor(offset_v_px)
    fraction_u, fraction_v = (offset_u_px - left)[..., None], (offset_v_px - above)[..., None]
    height, width = image.shape[:2]
    flat = image.reshape(-1, image.shape[-1])
    low_u, low_v = column + left.astype(np.intp), row + above.astype(np.intp)
    columns = [np.clip(low_u + step, 0, width - 1) for step in (0, 1)]
    rows = [np.clip(low_v + step, 0, height - 1) * width for step in (0, 1)]
    upper, lower = (
        _lerp(flat[start + columns[0]], flat[start + columns[1]], fraction_u) for start in rows
    )
    return _lerp(upper, lower, fraction_v)


def _lerp(
    one: npt.NDArray[Real], other: npt.NDArray[Real], fraction: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    # One product less than the symmetric form, and exact at fraction 0.
    mixed: npt.NDArray[Real] = one + fraction * (other - one)
    return mixed
