"""Linear light of three channels in one 64-bit integer: a sample costs a look-up and an addition.

Each channel has a field of 21 bits. A sample's level is quantised so that the sum of all samples of
a pixel fits its field, and a table of all possible sums gives the encoded grey: no division, no
float, no rounding twice. With up to 5 x 5 samples a level has 16 bits: finer than a 20th of an sRGB
step even in the darkest, steepest part of the curve (12.92 * 255 / 65535); with 16 x 16 it has 13
bits, 0.4 of such a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from catoptra_server.scene.colour import srgb_from_linear

Packed = npt.NDArray[np.uint64]
Float32s = npt.NDArray[np.float32]

_FIELD_BITS = 21
_FIELD_MASK = np.uint64(2**_FIELD_BITS - 1)
_SHIFTS = tuple(np.uint64(_FIELD_BITS * channel) for channel in range(3))


@dataclass(frozen=True, slots=True, eq=False)
class LightScale:
    """The levels of one sample and the grey of every sum, for a number of samples a pixel.

    encoded: (samples * top + 1,) uint8 sRGB of each sum.
    """

    samples: int
    top: int
    encoded: npt.NDArray[np.uint8]

    @classmethod
    def for_samples(cls, samples: int) -> LightScale:
        """Return the finest scale whose sums fit: `samples` is the number a pixel, at most 256."""
        top = min(2**16 - 1, int(_FIELD_MASK) // samples)
        return cls(samples, top, _encoded_sums(samples * top))

    def packed(self, radiance: Float32s) -> Packed:
        """Return (n,) packed levels of (3, n) radiance, clipped to [0, 1] as a sensor does."""
        levels = (np.clip(radiance, 0.0, 1.0) * self.top + 0.5).astype(np.uint64)
        light: Packed = levels[0] | (levels[1] << _SHIFTS[1]) | (levels[2] << _SHIFTS[2])
        return light

    def pixel_sums(self, light: Packed) -> Packed:
        """Return (n,) sums of (n * samples,) packed levels, pixel by pixel."""
        total = light[0 :: self.samples].copy()
        for offset in range(1, self.samples):
            total += light[offset :: self.samples]
        return total

    def colours(self, sums: Packed) -> npt.NDArray[np.uint8]:
        """Return (n, 3) uint8 sRGB of (n,) sums."""
        rgb = np.zeros((len(sums), 3), dtype=np.uint8)
        for channel, shift in enumerate(_SHIFTS):
            level = ((sums >> shift) & _FIELD_MASK).view(np.int64)
            # Levels are within the table; "clip" only spares take() a pass that checks them.
            rgb[:, channel] = self.encoded.take(level, mode="clip")
        return rgb


@cache
def _encoded_sums(highest: int) -> npt.NDArray[np.uint8]:
    """Return (highest + 1,) sRGB greys of sums up to the brightest; once for all views."""
    encoded = np.rint(255.0 * srgb_from_linear(np.arange(highest + 1) / highest)).astype(np.uint8)
    encoded.setflags(write=False)
    return encoded
