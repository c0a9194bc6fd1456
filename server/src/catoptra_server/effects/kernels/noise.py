"""Random numbers for pixels, the same bits in NumPy and in the kernel's stages.

Counter-based: a 32-bit integer hash of pixel and key, so that neither threads nor tiles nor their
order matter. Source of the hash: pcg3d, Jarzynski and Olano 2020, "Hash Functions for GPU
Rendering", JCGT 9(3). Normal variates come from a table of 2^16 quantiles of unit variance, one
lookup for each half of a word; the sum of both over sqrt(2) is at most `MAX_NORMAL_VARIATE`.
"""

from __future__ import annotations

import zlib
from functools import cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from catoptra_server.world.camera_state import NoiseSeed

UInt32Array = npt.NDArray[np.uint32]  # (3,)
_NUM_QUANTILES = 2**16
_SQRT_HALF = np.float32(np.sqrt(0.5))
# Of the linear congruential generator that opens pcg3d (Numerical Recipes' constants).
_MULTIPLIER, _INCREMENT = np.uint32(1664525), np.uint32(1013904223)


def pcg3d(
    x: UInt32Array, y: UInt32Array, z: UInt32Array
) -> tuple[UInt32Array, UInt32Array, UInt32Array]:
    """Hash three 32-bit words to three uniform words; arrays broadcast, arithmetic is mod 2^32."""
    x, y, z = (word * _MULTIPLIER + _INCREMENT for word in (x, y, z))
    # The order of these three lines is part of the hash: each uses the word mixed before.
    x = x + y * z
    y = y + z * x
    z = z + x * y
    x, y, z = (word ^ (word >> np.uint32(16)) for word in (x, y, z))
    x = x + y * z
    y = y + z * x
    z = z + x * y
    return x, y, z


def frame_noise_key(seed: NoiseSeed, purpose: str) -> UInt32Array:
    """Key, (3,), of the random numbers of one exposure, for one purpose."""
    return _noise_key(*seed.camera_key, seed.tick, purpose)


def camera_noise_key(seed: NoiseSeed, purpose: str) -> UInt32Array:
    """Key, (3,), of a camera's fixed pattern, the same in every exposure."""
    return _noise_key(*seed.camera_key, 0, purpose)


def _noise_key(first: int, second: int, tick: int, purpose: str) -> UInt32Array:
    # The purpose's checksum separates the streams of effects that share camera and tick; CRC-32 is
    # the same on every platform and in every run, unlike hash().
    salt = zlib.crc32(purpose.encode())
    inputs = (first ^ salt, second, tick & 0xFFFFFFFF)
    x, y, z = (np.array([word], dtype=np.uint32) for word in inputs)
    return np.concatenate(pcg3d(x, y, z))


def normal_variates(key: UInt32Array, height: int, width: int) -> npt.NDArray[np.float32]:
    """Normal variates, (height, width, 3), one for each pixel and colour."""
    x = np.arange(width, dtype=np.uint32)[None, :] + key[0]
    y = np.arange(height, dtype=np.uint32)[:, None] + key[1]
    table = normal_quantile_table()
    variates = np.zeros((height, width, 3), dtype=np.float32)
    # One float32 addition and one product per variate: operations that IEEE 754 rounds alike here
    # and in C, which Box-Muller's logarithm and cosine are not.
    for channel, word in enumerate(pcg3d(x, y, key[2:])):
        low = table.take(word & np.uint32(0xFFFF))
        variates[..., channel] = (low + table.take(word >> np.uint32(16))) * _SQRT_HALF
    return variates


@cache
def normal_quantile_table() -> npt.NDArray[np.float32]:
    """Quantiles (i + 1/2) / 2^16 of the normal distribution, (2^16,), scaled to unit variance."""
    count = _NUM_QUANTILES
    quantile = NormalDist().inv_cdf
    # Half is computed and mirrored, so that the table's mean is exactly 0.
    upper = np.array([quantile((index + 0.5) / count) for index in range(count // 2, count)])
    table = np.concatenate((-upper[::-1], upper))
    # Quantiles at the centres of equal shares miss the tails' variance; without the division the
    # photon-transfer curve would be too low.
    scaled: npt.NDArray[np.float32] = (table / table.std()).astype(np.float32)
    scaled.setflags(write=False)
    return scaled


# Twice the table's last entry, that of the quantile 1 - 2^-17, over sqrt(2); rounded up.
MAX_NORMAL_VARIATE = 6.12
