"""A texture laid out for many look-ups at once. Float64 twin: scene/shading.sample_texture.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves the array:
no index is wrapped, which saves integer divisions, a third of the look-up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.texture_files import Texture


@dataclass(frozen=True, slots=True, eq=False)
class PaddedTexture:
    """Linear texels of an image and its border, channel by channel."""

    width: int
    """Columns of the image, without border."""
    height: int
    """Rows of the image, without border."""
    texels: Float32s
    """(3, (height + 2) (width + 2)) linear radiance."""

    @classmethod
    def from_image(cls, image: Texture) -> PaddedTexture:
        """Layout of an (h, w, 3) sRGB image."""
        # Linear before filtering, as GL_SRGB8 textures are: the mean of encoded values would be
        # too dark. By a table and a channel at a time: float64 images took 100 bytes a texel.
        linear_from_byte = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
        height, width = image.shape[:2]
        texels = np.zeros((3, (height + 2) * (width + 2)), dtype=np.float32)
        for channel in range(3):
            linear = linear_from_byte[image[..., channel]]
            texels[channel] = np.pad(linear, 1, mode="wrap").reshape(-1)
        return cls(width, height, texels)

    def sample(self, u: Float32s, v: Float32s) -> Float32s:
        """(3, n) linear colours at (n,) coordinates, bilinear; the texture repeats."""
        column, fx = _texel_and_fraction(u, self.width)
        row, fy = _texel_and_fraction(v, self.height)
        first = row * (self.width + 2) + column
        # a + f (b - a) in place: fewer temporaries than weights of four texels, and exact for
        # equal texels.
        upper = self._interpolate_columns(first, fx)
        upper += fy * (self._interpolate_columns(first + (self.width + 2), fx) - upper)
        return upper

    def _interpolate_columns(self, left: npt.NDArray[np.int32], fx: Float32s) -> Float32s:
        """(3, n) colours between texels and their right neighbours."""
        a: Float32s = self.texels.take(left, axis=1)
        a += fx * (self.texels.take(left + 1, axis=1) - a)
        return a


def _texel_and_fraction(coordinate: Float32s, size: int) -> tuple[npt.NDArray[np.int32], Float32s]:
    """Padded index of the texel before a coordinate, and the fraction beyond it: [0, 1)."""
    # Half a texel back to the centre of the texel before, one on for the border.
    position = (coordinate - np.floor(coordinate)) * np.float32(size) + np.float32(0.5)
    texel = position.astype(np.int32)
    return texel, position - texel.astype(np.float32)
