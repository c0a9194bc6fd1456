"""Linear texels with a border, as the kernel looks them up. Twin: scene/shading.sample_texture.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves the array.
Four floats a texel: one vector load each.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.texture_files import Texture


def pad_texels(image: Texture) -> npt.NDArray[np.float32]:
    """(h + 2, w + 2, 4) linear texels of an (h, w, 3) sRGB image; the fourth channel is zero."""
    # Linear before filtering, as GL_SRGB8 textures are: the mean of encoded values would be too
    # dark. By a table: float64 images took 100 bytes a texel.
    linear_from_byte = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
    height, width = image.shape[:2]
    texels = np.zeros((height + 2, width + 2, 4), dtype=np.float32)
    texels[1:-1, 1:-1, :3] = linear_from_byte[image]
    texels[0], texels[-1] = texels[-2], texels[1]
    texels[:, 0], texels[:, -1] = texels[:, -2], texels[:, 1]
    return texels
