"""What rays show that meet no surface, by direction: a map of linear radiance.

The map is octahedral: a direction's place is that of its point on |x| + |y| + |z| = 1, seen from
above, the lower half mirrored outwards; up is in the middle, straight down at the corners. Texels
are 32 bits: mantissas of 9 bits of R, G and B, and an exponent of 5 bits, biased by 15. They are
interpolated bilinearly; a border of one texel repeats what lies beyond each edge. Twins:
render/trace/kernel/src/sky.c and glsl/sky.frag. A square of 1024 texels is 4 MB and 0.2 degrees
fine; one of float32 is 12 MB, and one of latitudes takes two functions of angle per ray.
Source: Engelhardt & Dachsbacher 2008, "Octahedron Environment Maps"; the packing is that of
OpenGL's EXT_texture_shared_exponent.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import power
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.array_cache import ArrayCache
from catoptra_server.world.world_description import Rgb

Texels = npt.NDArray[np.uint32]

_MANTISSA_BITS, _EXPONENT_SHIFT, _BIAS, _MAX_EXPONENT = 9, 27, 24, 31
_MAX_MANTISSA = 2**_MANTISSA_BITS - 1
MAX_RADIANCE = float(_MAX_MANTISSA * 2 ** (_MAX_EXPONENT - _BIAS))
"""Largest radiance of a texel; what is brighter has this one."""


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """Radiance by direction, world frame."""

    texels: Texels
    """(size + 2, size + 2) texels with the border; read-only."""
    bounds: Floats
    """(3, 3) least, largest and mean radiance of each colour."""

    @property
    def least(self) -> Rgb:
        """Smallest radiance of each colour in any direction."""
        return cast("Rgb", tuple(self.bounds[0].tolist()))

    @property
    def largest(self) -> Rgb:
        """Largest radiance likewise."""
        return cast("Rgb", tuple(self.bounds[1].tolist()))

    @property
    def mean(self) -> Rgb:
        """Mean over all directions."""
        return cast("Rgb", tuple(self.bounds[2].tolist()))

    @property
    def size(self) -> int:
        """Texels along a side, without the border."""
        return len(self.texels) - 2

    def decode(self) -> Floats:
        """(size + 2, size + 2, 3) radiance of all texels."""
        return _decode(self.texels)

    def radiance(self, directions: Floats) -> Floats:
        """(n, 3) linear radiance of (n, 3) directions of any length, world frame."""
        x, y, z = (directions / np.abs(directions).sum(axis=-1, keepdims=True)).T
        outer_x = np.where(x < 0.0, -1.0, 1.0) * (1.0 - np.abs(y))
        outer_y = np.where(y < 0.0, -1.0, 1.0) * (1.0 - np.abs(x))
        below = z > 0.0
        places = np.stack((np.where(below, outer_x, x), np.where(below, outer_y, y)))
        places = 0.5 * self.size * places + (0.5 * self.size + 0.5)
        (left, top), (fx, fy) = places.astype(np.intp), (places % 1.0)[..., None]
        a, b = (_decode(self.texels[top, left + i]) for i in range(2))
        c, d = (_decode(self.texels[top + 1, left + i]) for i in range(2))
        return np.asarray((1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d))


def texel_directions(size: int) -> Floats:
    """(size, size, 3) directions of the texels of a map on |x| + |y| + |z| = 1, world frame."""
    steps = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    u, v = steps[None, :], steps[:, None]
    z = np.abs(u) + np.abs(v) - 1.0
    x = np.where(z > 0.0, np.copysign(1.0 - np.abs(v), u), u)
    y = np.where(z > 0.0, np.copysign(1.0 - np.abs(u), v), v)
    return np.stack((x, y, z), axis=-1)


def solid_angles(size: int) -> Floats:
    """(size, size) solid angles of the texels of a map; their sum is exactly that of a sphere."""
    # Texels have equal areas on the octahedron, whose faces all have the same distance.
    weights = power(np.square(texel_directions(size)).sum(axis=-1), -1.5)
    return np.asarray(weights * (4.0 * math.pi / weights.sum()))


def make_panorama(radiance: Floats) -> Panorama:
    """Panorama of (size, size, 3) radiance in the directions of `texel_directions`."""
    texels = np.pad(_encode(radiance), 1)
    # Beyond an edge is the mirror image of the texels inside it.
    texels[0, :], texels[-1, :] = texels[1, ::-1], texels[-2, ::-1]
    texels[:, 0], texels[:, -1] = texels[::-1, 1], texels[::-1, -2]
    texels.setflags(write=False)
    kept, weights = _decode(texels[1:-1, 1:-1]), solid_angles(len(radiance)) / (4.0 * math.pi)
    mean = (weights[..., None] * kept).sum(axis=(0, 1))
    return Panorama(texels, np.stack((kept.min(axis=(0, 1)), kept.max(axis=(0, 1)), mean)))


def restore_panorama(
    cache: ArrayCache, key: str, count: int
) -> tuple[Panorama, tuple[npt.NDArray[Any], ...]] | None:
    """Panorama of a cache, and the arrays behind its own, `count` in all; None without a sound one.

    The kernel checks no place in the map again.
    """
    arrays = cache.read(key, count)
    if arrays is None or arrays[0].dtype != np.uint32 or arrays[0].ndim != 2:
        return None
    (height, width), bounds = arrays[0].shape, arrays[1]
    is_sound = height == width > 2 and bounds.shape == (3, 3) and np.isfinite(bounds).all()
    return (Panorama(arrays[0], bounds), arrays[2:]) if is_sound else None


def _encode(radiance: Floats) -> Texels:
    """(...) texels of (..., 3) radiance, rounded to the nearest."""
    clipped = np.clip(radiance, 0.0, MAX_RADIANCE)
    exponent = np.maximum(np.frexp(clipped.max(axis=-1))[1] + _BIAS - _MANTISSA_BITS, 0)
    mantissa = _round_mantissas(clipped, exponent)
    # Rounding may reach the next power of two.
    exponent += mantissa.max(axis=-1) > _MAX_MANTISSA
    r, g, b = np.moveaxis(_round_mantissas(clipped, exponent), -1, 0).astype(np.uint32)
    packed = r | g << _MANTISSA_BITS | b << 2 * _MANTISSA_BITS
    return np.asarray(packed | exponent.astype(np.uint32) << _EXPONENT_SHIFT)


def _round_mantissas(radiance: Floats, exponent: npt.NDArray[np.integer]) -> Floats:
    return np.asarray(np.floor(np.ldexp(radiance, (_BIAS - exponent)[..., None]) + 0.5))


def _decode(texels: Texels) -> Floats:
    """(..., 3) radiance of (...) texels."""
    shifts = np.arange(3, dtype=np.uint32) * np.uint32(_MANTISSA_BITS)
    mantissas = texels[..., None] >> shifts & np.uint32(_MAX_MANTISSA)
    exponent = (texels >> np.uint32(_EXPONENT_SHIFT)).astype(np.int32) - _BIAS
    return np.asarray(np.ldexp(mantissas.astype(np.float64), exponent[..., None]))
