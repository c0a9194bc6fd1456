"""Texels with a border, as the kernel looks them up. Twin: scene/shading.sample_texture.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves the array.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.texture_files import Texture


def pad_texels(image: Texture) -> npt.NDArray[np.uint8]:
    """(h + 2, w + 2, 4) sRGB texels of an (h, w, 3) image; the fourth channel is zero."""
    height, width = image.shape[:2]
    texels = np.zeros((height + 2, width + 2, 4), dtype=np.uint8)
    texels[1:-1, 1:-1, :3] = image
    texels[0], texels[-1] = texels[-2], texels[1]
    texels[:, 0], texels[:, -1] = texels[:, -2], texels[:, 1]
    return texels


@cache
def linear_table() -> npt.NDArray[np.float32]:
    """(256,) linear light of sRGB bytes."""
    table = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
    table.setflags(write=False)
    return table
