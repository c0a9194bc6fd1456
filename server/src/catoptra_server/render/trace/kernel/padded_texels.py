"""Texels with a border, as the kernel looks them up. Twin: scene/shading.sample_texture.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves the array.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.texture_files import Texture

MAX_TEXEL = 65535
"""Texel of white."""


def pad_texels(image: Texture) -> npt.NDArray[np.uint16]:
    """(h + 2, w + 2, 4) linear texels of an (h, w, 3) sRGB image; the fourth channel is zero."""
    # Linear before filtering, as GL_SRGB8 textures are: the mean of encoded values would be too
    # dark. By a table: float64 images took 100 bytes a texel.
    linear = linear_from_srgb(np.arange(256) / 255.0)
    from_byte = np.rint(MAX_TEXEL * linear).astype(np.uint16)
    height, width = image.shape[:2]
    texels = np.zeros((height + 2, width + 2, 4), dtype=np.uint16)
    texels[1:-1, 1:-1, :3] = from_byte[image]
    texels[0], texels[-1] = texels[-2], texels[1]
    texels[:, 0], texels[:, -1] = texels[:, -2], texels[:, 1]
    return texels
