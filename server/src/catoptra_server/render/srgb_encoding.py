"""sRGB bytes of linear light by a table: what images cost after their effects, and in the kernel.

Float64 twin: scene/colour.srgb_from_linear.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from catoptra_server.world.world_description import srgb_from_linear

MAX_LEVEL = 2**16 - 1
"""Level of white: a level is a 20th of a grey even in the curve's steepest part (12.92 * 255)."""


def encode_srgb(light: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """uint8 sRGB of linear light, clipped to [0, 1]; black where it is not a number."""
    # Black where it is not a number: fmax prefers numbers.
    clipped = np.minimum(np.fmax(light, np.float32(0.0)), np.float32(1.0))
    levels = (clipped * np.float32(MAX_LEVEL) + np.float32(0.5)).astype(np.int32)
    return srgb_table().take(levels)


@cache
def srgb_table() -> npt.NDArray[np.uint8]:
    """(MAX_LEVEL + 1,) sRGB greys of evenly spaced light from 0 to 1."""
    linear = np.arange(MAX_LEVEL + 1) / MAX_LEVEL
    encoded = np.rint(255.0 * srgb_from_linear(linear)).astype(np.uint8)
    # Shared by all views and by the kernel.
    encoded.setflags(write=False)
    return encoded
