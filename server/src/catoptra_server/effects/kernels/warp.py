"""Warp of an image by a displacement map that is the same in every frame.

Bilinear in linear radiance, with neighbours and weights computed once; outside the image the border
pixel is repeated. A pixel whose displacement is a whole number of pixels is copied bit by bit.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import Real

Indices = npt.NDArray[np.intp]
Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class WarpMap:
    """Source pixels and weights of every pixel of a warped image of h x w pixels."""

    corner_indices: tuple[Indices, Indices, Indices, Indices]
    """(h w,) flat indices of the upper left, upper right, lower left, lower right neighbour."""
    right_weights: Float32Array
    """(h w, 3) weights of the right neighbours, the same for the three colours."""
    lower_weights: Float32Array
    """(h w, 3) weights of the lower neighbours, the same for the three colours."""


def warp_map_from_offsets(offsets_px: Float32Array) -> WarpMap:
    """Warp map of an image whose pixels are sampled (h, w, 2) offsets from their centres, px."""
    height, width = offsets_px.shape[:2]
    whole = np.floor(offsets_px)
    row, column = np.indices((height, width), sparse=True)
    # Clipping the indices repeats the border pixels.
    columns, rows = (
        [np.clip(pixel + whole[..., axis].astype(np.intp) + step, 0, last) for step in (0, 1)]
        for axis, pixel, last in ((0, column, width - 1), (1, row, height - 1))
    )
    right, lower = np.moveaxis((offsets_px - whole).reshape(-1, 2), -1, 0)
    return WarpMap(
        (
            (rows[0] * width + columns[0]).ravel(),
            (rows[0] * width + columns[1]).ravel(),
            (rows[1] * width + columns[0]).ravel(),
            (rows[1] * width + columns[1]).ravel(),
        ),
        # Stored for each colour: a product of equal shapes takes a tenth of the time of a broadcast
        # over an axis of three.
        np.repeat(right[:, None], 3, axis=1),
        np.repeat(lower[:, None], 3, axis=1),
    )


def warp(image: npt.NDArray[Real], warp_map: WarpMap) -> npt.NDArray[Real]:
    """Sample a (h, w, 3) image as a warp map says; the result is a new array."""
    flat = image.reshape(-1, 3)
    # All indices are inside the image already: mode `clip` only spares NumPy's own range check.
    above, right, below, diagonal = (
        flat.take(indices, axis=0, mode="clip") for indices in warp_map.corner_indices
    )
    above += warp_map.right_weights * (right - above)
    below += warp_map.right_weights * (diagonal - below)
    above += warp_map.lower_weights * (below - above)
    return above.reshape(image.shape)
