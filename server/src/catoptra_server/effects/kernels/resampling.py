"""Light between the pixels of a picture, for effects that move or spread what pixels show.

Bilinear, in linear light; pixels' middles are at +0.5. Beyond the border the last pixel's light
goes on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.effect import Real

Integers = npt.NDArray[np.signedinteger[Any]]


def sample_bilinear(
    image: npt.NDArray[Real], u: npt.NDArray[Real], v: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    """Return the (..., 3) light of a (h, w, 3) picture at places (u, v), of any one shape."""
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
    """Return the (..., 3) light so far aside of the middles of pixels (column, row).

    As a place in a wide picture, what is aside would have lost its last bits in float32.
    """
    left, above = np.floor(offset_u_px), np.floor(offset_v_px)
    share_u, share_v = (offset_u_px - left)[..., None], (offset_v_px - above)[..., None]
    height, width = image.shape[:2]
    flat = image.reshape(-1, image.shape[-1])
    low_u, low_v = column + left.astype(np.intp), row + above.astype(np.intp)
    columns = [np.clip(low_u + step, 0, width - 1) for step in (0, 1)]
    rows = [np.clip(low_v + step, 0, height - 1) * width for step in (0, 1)]
    upper, lower = (_lerp(flat[at + columns[0]], flat[at + columns[1]], share_u) for at in rows)
    return _lerp(upper, lower, share_v)


def _lerp(
    one: npt.NDArray[Real], other: npt.NDArray[Real], fraction: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    mixed: npt.NDArray[Real] = one + fraction * (other - one)
    return mixed
