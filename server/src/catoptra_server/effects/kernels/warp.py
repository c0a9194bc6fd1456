"""A picture read aside of where it stands, by a map that stays the same from frame to frame.

As `resampling.bilinear_aside`, prepared once: which four pixels each pixel lies between, and how
near to which. Where a pixel is read from a pixel's middle it keeps every bit of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.effect import Real

Indices = npt.NDArray[np.intp]
Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class WarpMap:
    """Where (h w) pixels are read: upper left, upper right, lower left, lower right.

    across, down: (h w, 3) the shares of what is right and below, equal for the three colours.
    """

    corner_indices: tuple[Indices, Indices, Indices, Indices]
    right_weights: Float32Array
    lower_weights: Float32Array


def warp_map_from_offsets(offsets_px: Float32Array) -> WarpMap:
    """Return the warp of a picture whose pixels are read (h, w, 2) aside of their middles, px."""
    height, width = offsets_px.shape[:2]
    whole = np.floor(offsets_px)
    row, column = np.indices((height, width), sparse=True)
    columns, rows = (
        [np.clip(at + whole[..., axis].astype(np.intp) + step, 0, last) for step in (0, 1)]
        for axis, at, last in ((0, column, width - 1), (1, row, height - 1))
    )
    across, down = np.moveaxis((offsets_px - whole).reshape(-1, 2), -1, 0)
    return WarpMap(
        (
            (rows[0] * width + columns[0]).ravel(),
            (rows[0] * width + columns[1]).ravel(),
            (rows[1] * width + columns[0]).ravel(),
            (rows[1] * width + columns[1]).ravel(),
        ),
        np.repeat(across[:, None], 3, axis=1),
        np.repeat(down[:, None], 3, axis=1),
    )


def warp(image: npt.NDArray[Real], warp_map: WarpMap) -> npt.NDArray[Real]:
    """Return a (h, w, 3) picture as the warp reads it, a new array."""
    flat = image.reshape(-1, 3)
    # All of them are within the picture: what `clip` saves is only the check.
    above, right, below, far = (
        flat.take(at, axis=0, mode="clip") for at in warp_map.corner_indices
    )
    above += warp_map.right_weights * (right - above)
    below += warp_map.right_weights * (far - below)
    above += warp_map.lower_weights * (below - above)
    return above.reshape(image.shape)
