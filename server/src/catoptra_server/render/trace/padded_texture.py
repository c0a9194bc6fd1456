"""A texture laid out for many look-ups at once. Float64 twin: shading.texture_value.

The image is repeated by one texel on every side, so that a bilinear look-up never leaves it: no
index is wrapped, and the integer divisions that this would cost, a third of the look-up, are
spared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.scene_mesh import Texture


@dataclass(frozen=True, slots=True, eq=False)
class PaddedTexture:
    """Linear texels (3, (h + 2) * (w + 2)) of a (h, w) image and its border, channel by channel."""

    width: int
    height: int
    texels: Float32s

    @classmethod
    def from_image(cls, image: Texture) -> PaddedTexture:
        """Return the layout of an (h, w, 3) sRGB image."""
        linear = linear_from_srgb(image / 255.0).astype(np.float32)
        padded = np.pad(linear, ((1, 1), (1, 1), (0, 0)), mode="wrap")
        height, width = image.shape[:2]
        return cls(width, height, np.ascontiguousarray(padded.reshape(-1, 3).T))

    def sample(self, u: Float32s, v: Float32s) -> Float32s:
        """Return (3, n) linear colours at (n,) coordinates; the texture repeats."""
        column, fx = _texel_and_fraction(u, self.width)
        row, fy = _texel_and_fraction(v, self.height)
        first = row * (self.width + 2) + column
        upper = self._interpolate_columns(first, fx)
        upper += fy * (self._interpolate_columns(first + (self.width + 2), fx) - upper)
        return upper

    def _interpolate_columns(self, left: npt.NDArray[np.int32], fx: Float32s) -> Float32s:
        a: Float32s = self.texels.take(left, axis=1)
        a += fx * (self.texels.take(left + 1, axis=1) - a)
        return a


def _texel_and_fraction(coordinate: Float32s, size: int) -> tuple[npt.NDArray[np.int32], Float32s]:
    """Return the padded index of the texel before a place, and how far on the place is: [0, 1)."""
    # Half a texel back to the middle of the texel before, one on for the border.
    place = (coordinate - np.floor(coordinate)) * np.float32(size) + np.float32(0.5)
    texel = place.astype(np.int32)
    return texel, place - texel.astype(np.float32)
