"""Random numbers for pixels, the same bits in NumPy and GLSL. Twin: glsl/include/noise.glsl.

Counter-based: a 32-bit integer hash of pixel and key, so that neither threads nor tiles nor their
order matter. Source of the hash: pcg3d, Jarzynski and Olano 2020, "Hash Functions for GPU
Rendering", JCGT 9(3). Normal numbers come from a table of 2^16 quantiles of unit variance, a
look-up for each half of a word; the sum of the two, over sqrt(2), ends at `MAX_NORMAL_VARIATE`. An
addition and a product are all that float32 does, so both sides draw the same.
"""

from __future__ import annotations

import zlib
from functools import cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from catoptra_server.capture.noise_seed import NoiseSeed

UInt32Array = npt.NDArray[np.uint32]  # (3,)
QUANTILE_TABLE_SIDE = 256
_SQRT_HALF = np.float32(np.sqrt(0.5))
_MULTIPLIER, _INCREMENT = np.uint32(1664525), np.uint32(1013904223)


def pcg3d(
    x: UInt32Array, y: UInt32Array, z: UInt32Array
) -> tuple[UInt32Array, UInt32Array, UInt32Array]:
    """Return three uniform words of three words; arrays broadcast. Arithmetic is modulo 2^32."""
    x, y, z = (word * _MULTIPLIER + _INCREMENT for word in (x, y, z))
    x = x + y * z
    y = y + z * x
    z = z + x * y
    x, y, z = (word ^ (word >> np.uint32(16)) for word in (x, y, z))
    x = x + y * z
    y = y + z * x
    z = z + x * y
    return x, y, z


def frame_noise_key(seed: NoiseSeed, purpose: str) -> UInt32Array:
    """Return the three words that the numbers of one exposure are keyed by, for one purpose."""
    return _noise_key(*seed.camera_key, seed.tick, purpose)


def camera_noise_key(seed: NoiseSeed, purpose: str) -> UInt32Array:
    """Return the words of a camera's own pattern, the same in every exposure."""
    return _noise_key(*seed.camera_key, 0, purpose)


def _noise_key(first: int, second: int, index: int, purpose: str) -> UInt32Array:
    salt = zlib.crc32(purpose.encode())
    inputs = (first ^ salt, second, index & 0xFFFFFFFF)
    x, y, z = (np.array([word], dtype=np.uint32) for word in inputs)
    return np.concatenate(pcg3d(x, y, z))


def normal_variates(key: UInt32Array, height: int, width: int) -> npt.NDArray[np.float32]:
    """Return (height, width, 3) normal numbers, one for each pixel and colour."""
    x = np.arange(width, dtype=np.uint32)[None, :] + key[0]
    y = np.arange(height, dtype=np.uint32)[:, None] + key[1]
    table = normal_quantile_table()
    drawn = np.zeros((height, width, 3), dtype=np.float32)
    for channel, word in enumerate(pcg3d(x, y, key[2:])):
        low = table.take(word & np.uint32(0xFFFF))
        drawn[..., channel] = (low + table.take(word >> np.uint32(16))) * _SQRT_HALF
    return drawn


@cache
def normal_quantile_table() -> npt.NDArray[np.float32]:
    """Return the (2^16,) middle quantiles of the normal distribution, scaled to unit variance."""
    count = QUANTILE_TABLE_SIDE * QUANTILE_TABLE_SIDE
    quantile = NormalDist().inv_cdf
    upper = np.array([quantile((index + 0.5) / count) for index in range(count // 2, count)])
    table = np.concatenate((-upper[::-1], upper))
    scaled: npt.NDArray[np.float32] = (table / table.std()).astype(np.float32)
    scaled.setflags(write=False)
    return scaled


# Twice the table's last entry, over sqrt(2); the entry is that of the quantile 1 - 2^-17.
MAX_NORMAL_VARIATE = 6.12
