"""Texels with a border, as the kernel looks them up. Twin: scene/shading.sample_texture.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves the array.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

MAX_TEXEL = 65535
"""Texel of white."""


def pad_texels(linear: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """(h + 2, w + 2, 4) texels of (h, w, 3) linear light; the fourth channel is zero."""
    height, width = linear.shape[:2]
    texels = np.zeros((height + 2, width + 2, 4), dtype=np.uint16)
    np.rint(MAX_TEXEL * linear, out=texels[1:-1, 1:-1, :3], casting="unsafe")
    texels[0], texels[-1] = texels[-2], texels[1]
    texels[:, 0], texels[:, -1] = texels[:, -2], texels[:, 1]
    return texels
