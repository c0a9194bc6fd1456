"""Comparing images away from their edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image
from catoptra_server.world.world_description import srgb_from_linear


def grey_levels(light: npt.NDArray[np.floating]) -> Floats:
    """Encoded grey levels of linear light, not rounded."""
    return np.asarray(255.0 * srgb_from_linear(np.clip(light.astype(np.float64), 0.0, 1.0)))


def level_differences(one: Image, other: Image) -> npt.NDArray[np.int64]:
    """(h, w) largest difference of the three channels, in grey levels."""
    difference: npt.NDArray[np.int64] = np.abs(one.astype(np.int64) - other).max(axis=-1)
    return difference


def mask_away_from_edges(image: Image, *, contrast: int = 6) -> npt.NDArray[np.bool_]:
    """(h, w) True where the 3 x 3 neighbours vary by less than `contrast` levels.

    At an edge two renderers may both be right and show either side: a sample's position is rounded,
    a cube face is made of texels.
    """
    padded = np.pad(image.astype(np.int64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(0, 1))
    smooth: npt.NDArray[np.bool_] = (np.ptp(windows, axis=(-2, -1)) < contrast).all(axis=-1)
    return smooth
