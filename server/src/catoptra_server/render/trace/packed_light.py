"""Radiance of three channels in one 64-bit integer: a sample costs a look-up and an addition.

Each channel has a field of 21 bits. A sample's level is quantised so that the sum of all samples of
a pixel fits its field, and a table of all possible sums gives the encoded grey: no division, no
float, no rounding twice. With up to 5 x 5 samples a level has 16 bits: finer than a 20th of an sRGB
step even in the darkest, steepest part of the curve (12.92 * 255 / 65535); with 16 x 16 samples 13
bits, 0.4 of such a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.domain_checks import require_domain
from catoptra_server.scene.colour import srgb_from_linear

Packed = npt.NDArray[np.uint64]
Float32s = npt.NDArray[np.float32]

# The colours of pixels, (n, 3): uint8 sRGB, or float32 linear light.
Colours = npt.NDArray[np.uint8] | npt.NDArray[np.float32]

_GREY, _LINEAR = np.dtype(np.uint8), np.dtype(np.float32)

# Three fields of 21 bits fill 63 of 64; 256 samples of 13 bits fit one field.
_FIELD_BITS = 21
_FIELD_MASK = np.uint64(2**_FIELD_BITS - 1)
_MAX_SAMPLES = 256
_SHIFTS = tuple(np.uint64(_FIELD_BITS * channel) for channel in range(3))


class RadianceScale(Protocol):
    """Quantisation of radiance, and the colours of pixel sums."""

    @property
    def samples(self) -> int:
        """Number of samples a pixel."""

    @property
    def channel_dtype(self) -> np.dtype[np.uint8] | np.dtype[np.float32]:
        """Storage of one colour channel of a finished pixel."""

    def pack(self, radiance: Float32s) -> Packed:
        """(n,) packed levels of (3, n) radiance."""

    def sum_pixels(self, light: Packed) -> Packed:
        """(n,) sums of (n * samples,) packed levels, pixel by pixel."""

    def unpack(self, sums: Packed) -> Colours:
        """(n, 3) colours of (n,) sums."""


@dataclass(frozen=True, slots=True, eq=False)
class SrgbScale:
    """Levels of one sample and the sRGB grey of every sum."""

    samples: int
    """Samples of each pixel."""
    max_level: int
    """Level of white."""
    encoded: npt.NDArray[np.uint8]
    """(samples * max_level + 1,) uint8 sRGB of each sum."""
    channel_dtype: np.dtype[np.uint8] = _GREY
    """Storage of one colour channel."""

    @classmethod
    def for_samples(cls, samples: int) -> SrgbScale:
        """Finest scale whose sums fit, for 1 to 256 samples a pixel."""
        if not 1 <= samples <= _MAX_SAMPLES:
            raise DomainError(f"{samples} samples a pixel: from 1 to {_MAX_SAMPLES} can be summed")
        top = min(2**16 - 1, int(_FIELD_MASK) // samples)
        return cls(samples, top, _srgb_table(samples * top))

    def pack(self, radiance: Float32s) -> Packed:
        """(n,) packed levels of (3, n) radiance, clipped to [0, 1] as on a sensor.

        Raises:
            DomainError: Radiance that is not a number: its bits would spill over all three
                channels.
        """
        if np.isnan(radiance.min(initial=0.0)):
            require_domain(~np.isnan(radiance), radiance, "light is a number")
        return _pack_levels(np.clip(radiance, 0.0, 1.0) * self.max_level)

    def sum_pixels(self, light: Packed) -> Packed:
        """(n,) sums of (n * samples,) packed levels, pixel by pixel."""
        return _sum_samples(light, self.samples)

    def unpack(self, sums: Packed) -> npt.NDArray[np.uint8]:
        """(n, 3) uint8 sRGB of (n,) sums."""
        rgb = np.zeros((len(sums), 3), dtype=np.uint8)
        for channel, shift in enumerate(_SHIFTS):
            level = ((sums >> shift) & _FIELD_MASK).view(np.int64)
            # Levels are within the table; "clip" only spares take() a pass that checks them.
            rgb[:, channel] = self.encoded.take(level, mode="clip")
        return rgb


@dataclass(frozen=True, slots=True, eq=False)
class LinearScale:
    """Levels in linear light up to `max_radiance`, for light that is changed before the encoding.

    A level has as many bits as the sum of all samples leaves to one sample, at most 21.
    """

    samples: int
    """Samples of each pixel."""
    max_level: int
    """Level of `max_radiance`."""
    max_radiance: float
    """Greatest radiance that is not clipped."""
    channel_dtype: np.dtype[np.float32] = _LINEAR
    """Storage of one colour channel."""

    @classmethod
    def for_samples(cls, samples: int, *, max_radiance: float) -> LinearScale:
        """Finest scale up to a scene's greatest radiance, and to white at least."""
        return cls(samples, int(_FIELD_MASK) // samples, max(max_radiance, 1.0))

    def pack(self, radiance: Float32s) -> Packed:
        """(n,) packed levels of (3, n) radiance, clipped to the scale."""
        fraction = np.clip(radiance * np.float32(1.0 / self.max_radiance), 0.0, 1.0)
        return _pack_levels(fraction * self.max_level)

    def sum_pixels(self, light: Packed) -> Packed:
        """(n,) sums of (n * samples,) packed levels, pixel by pixel."""
        return _sum_samples(light, self.samples)

    def unpack(self, sums: Packed) -> npt.NDArray[np.float32]:
        """(n, 3) float32 mean radiance of (n,) sums."""
        unit = np.float32(self.max_radiance / (self.samples * self.max_level))
        fields = [((sums >> shift) & _FIELD_MASK).astype(np.float32) for shift in _SHIFTS]
        return np.stack(fields, axis=-1) * unit


def _pack_levels(levels: Float32s) -> Packed:
    whole = (levels + 0.5).astype(np.uint64)
    light: Packed = whole[0] | (whole[1] << _SHIFTS[1]) | (whole[2] << _SHIFTS[2])
    return light


def _sum_samples(light: Packed, samples: int) -> Packed:
    total = light[0::samples].copy()
    for offset in range(1, samples):
        total += light[offset::samples]
    return total


def encode_srgb(light: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """uint8 sRGB of linear light, by a table of 16 bits; light outside [0, 1] is clipped."""
    levels = (np.clip(light, 0.0, 1.0) * np.float32(_ENCODED_TOP) + np.float32(0.5)).astype(
        np.int32
    )
    return _srgb_table(_ENCODED_TOP).take(levels)


_ENCODED_TOP = 2**16 - 1


@cache
def _srgb_table(highest: int) -> npt.NDArray[np.uint8]:
    """(highest + 1,) sRGB greys of sums up to the brightest; shared by all views."""
    encoded = np.rint(255.0 * srgb_from_linear(np.arange(highest + 1) / highest)).astype(np.uint8)
    encoded.setflags(write=False)
    return encoded
