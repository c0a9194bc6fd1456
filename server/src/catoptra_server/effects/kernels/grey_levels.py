"""Grey levels of changes of light, the mean luminance of an image, and random numbers for pixels.

Criteria compare encoded values: the sRGB curve is 13 times as steep in the dark as a straight line
and 0.4 times as steep at white, so a bound in linear counts would be wrong by as much.

Random numbers are the same bits in NumPy and in the kernel's stages, which Box-Muller's logarithms
and cosines would not give. They are counter-based: a 32-bit integer hash of pixel and key, so that
neither threads nor tiles nor their order matter. The key is made of seed, robot, camera and tick.
Source of the hash: pcg3d, Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", JCGT 9(3).
Normal variates come from a table of 2^16 quantiles of unit variance, one lookup for each half of a
word; the sum of both over sqrt(2) is at most `MAX_NORMAL_VARIATE`.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from functools import cache, lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import dot, exp, ln
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel_grid
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects import (
    COUNTED_LEVELS,
    NO_SPILL,
    EffectChange,
    Gains,
    Real,
    SceneSummary,
    Spill,
    Threshold,
)
from catoptra_server.world.objects import NoiseSeed
from catoptra_server.world.world_description import srgb_from_linear


def grey_level(radiance: float) -> float:
    """Grey level of a linear radiance, 0 to 255, not rounded."""
    return 255.0 * float(srgb_from_linear(np.array(radiance)))


def max_change_by_exchange(fraction: float, max_radiance: float) -> float:
    """Largest change of a pixel that exchanges a fraction of its light with others, grey levels.

    Args:
        fraction: Largest weight, 0 to 1, of other pixels in a mean that has the pixel's own light
            in its place before; half the sum of |w - w'| for two kernels w and w'.
        max_radiance: Radiances from 0 up to this one occur.
    """
    # A black pixel beside the brightest changes most: the sRGB curve is concave from 0 on.
    return grey_level(fraction * max_radiance)


def exchange_by_shift(displacement_px: float) -> float:
    """Largest fraction of a pixel's light that a displacement takes from others.

    A pixel is a mean over its square, and a square shifted by (dx, dy) shares all but
    1 - (1 - |dx|) (1 - |dy|) <= |dx| + |dy| with itself; the same is the weight of other pixels in
    a bilinear interpolation. The displacement may have any direction.
    """
    return min(1.0, math.sqrt(2.0) * displacement_px)


def max_change_by_shift(displacement_px: float, max_radiance: float) -> float:
    """Largest change of a pixel whose light is displaced, grey levels."""
    return max_change_by_exchange(exchange_by_shift(displacement_px), max_radiance)


def max_change_by_gain(gain: float, max_radiance: float) -> float:
    """Largest change, in grey levels, of any radiance from 0 to `max_radiance` times a gain."""
    # In encoded levels the difference grows with radiance until one of both values is clipped:
    # darkened, the brightest unclipped radiance changes most; brightened, the radiance that the
    # gain takes exactly to white.
    if gain <= 1.0:
        brightest = min(max_radiance, 1.0)
        return grey_level(brightest) - grey_level(gain * brightest)
    just_white = min(max_radiance, 1.0 / gain)
    return grey_level(gain * just_white) - grey_level(just_white)


def max_change_by_factors(least: float, largest: float, summary: SceneSummary) -> float:
    """Largest change, in grey levels, of any radiance times any of an image's factors."""
    factors = {least, largest}
    if summary.exposes_itself and least > 0.0:
        # Automatic exposure takes back some mean of the factors: a pixel beside has the quotient.
        factors |= {least / largest, largest / least}
    return max(max_change_by_gain(one, summary.picture_radiance) for one in factors)


_NUM_RADIANCES = 2049


def max_change_by_offset(offset: Callable[[Floats], Floats], summary: SceneSummary) -> float:
    """Largest change, in grey levels of the picture, of any radiance that gains or loses an offset.

    Args:
        offset: Offset of each of (n,) radiances. Domain: offsets that grow with radiance, by less
            than radiance itself.
        summary: Radiances from 0 up to its largest occur, or up to the full well.
    """
    brightest = min(summary.max_radiance, 1.0)
    # Geometric spacing is fine in the dark, where the sRGB curve is steepest; between two of these
    # radiances a smooth offset changes the result by less than a thousandth.
    radiance = np.append(0.0, exp(np.linspace(ln(1e-7), 0.0, _NUM_RADIANCES)) * brightest)
    shift = offset(radiance)
    gain = summary.gains[1]
    light = np.stack((radiance, radiance + shift, radiance - shift))
    levels = 255.0 * srgb_from_linear(gain * light)
    return float(np.abs(levels[1:] - levels[0]).max())


def find_changes(
    one: npt.NDArray[Real], other: npt.NDArray[Real], gains: Gains, spill: Spill = NO_SPILL
) -> npt.NDArray[np.float64]:
    """Changes of the finished picture, grey levels, not rounded, between two versions of light.

    Light on its way to the picture is multiplied by any of the gains, and clipped there: a
    difference shows most where the larger value just reaches white. What spills over at a full well
    is added: a black pixel beside shows it most.
    """
    before, after = one.astype(np.float64), other.astype(np.float64)
    with np.errstate(divide="ignore"):
        to_white = 1.0 / np.maximum(np.maximum(before, after), 0.0)
    gain = np.clip(to_white, *gains)
    levels = srgb_from_linear(gain * before) - srgb_from_linear(gain * after)
    excess = np.maximum(spill[0] * before - 1.0, 0.0) - np.maximum(spill[0] * after - 1.0, 0.0)
    levels = np.abs(levels) + srgb_from_linear(spill[1] * np.abs(excess))
    return np.asarray(255.0 * np.minimum(levels, 1.0))


_SHOWN_AS_IT_IS = Threshold(0.0)


def measure_change(
    one: npt.NDArray[Real], other: npt.NDArray[Real], threshold: Threshold = _SHOWN_AS_IT_IS
) -> EffectChange:
    """Change of the finished picture between two versions, (h, w, 3), of light."""
    levels = find_changes(one, other, threshold.gains, threshold.spill).max(axis=-1)
    visible = levels > COUNTED_LEVELS
    if threshold.has_mosaic:
        visible = _reach_neighbours(visible)
    return EffectChange(float(levels.max()), float(visible.mean()))


def _reach_neighbours(pixels: Bools) -> Bools:
    """(h, w) pixels that a mosaic's colours show some of (h, w) pixels in.

    Red and blue are interpolated from all eight neighbours, green from those in row and column.
    """
    padded = np.pad(pixels, 1)
    reached = pixels | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    padded[1:-1, 1:-1][::2, 1::2] = padded[1:-1, 1:-1][1::2, ::2] = False  # green
    for rows, columns in product((slice(-2), slice(2, None)), repeat=2):
        reached |= padded[rows, columns]
    return reached


# Rec. 709, for linear red, green, blue.
_LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)


def mean_luminance(image: npt.NDArray[Real], camera: RadialCamera) -> float:
    """Mean luminance of the pixels that a mirror or lens shows anything in."""
    # Summed in float64 for any image, so a float32 image and its reference have one gain.
    colours = image.sum(axis=(0, 1), dtype=np.float64)
    return float(dot(colours, np.array(_LUMINANCE_WEIGHTS))) / max(count_valid_pixels(camera), 1)


@lru_cache(maxsize=16)
def count_valid_pixels(camera: RadialCamera) -> int:
    """Number of pixels whose centre has a direction; all others are black."""
    return int(valid_pixels(camera).sum())


@lru_cache(maxsize=4)
def valid_pixels(camera: RadialCamera) -> Bools:
    """Pixels, (h, w), whose centre has a direction."""
    if isinstance(camera, OmniCamera):
        u, v = np.arange(0.5, camera.width_px), np.arange(0.5, camera.height_px)
        valid = direction_from_pixel_grid(camera, u, v)[1]
    else:
        valid = camera.direction_from_pixel(pixel_sample_positions(camera))[1][..., 0]
    valid.setflags(write=False)
    return valid


UInt32Array = npt.NDArray[np.uint32]  # (3,)


FRAME_NOISE_EFFECTS = frozenset({"ReadNoise", "ShotNoise"})
"""Names of the effects with random numbers of their own in each exposure."""


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


# Twice the table's last entry, the quantile 1 - 2^-17, over sqrt(2); rounded up.
MAX_NORMAL_VARIATE = 6.12


def normal_variates(key: UInt32Array, height: int, width: int) -> npt.NDArray[np.float32]:
    """Normal variates, (height, width, 3), one for each pixel and colour."""
    x = np.arange(width, dtype=np.uint32)[None, :] + key[0]
    y = np.arange(height, dtype=np.uint32)[:, None] + key[1]
    table = normal_quantile_table()
    variates = np.zeros((height, width, 3), dtype=np.float32)
    # One float32 addition and one product per variate: operations that IEEE 754 rounds alike here
    # and in C, which Box-Muller's logarithm and cosine are not.
    for first in range(0, height, _BAND_ROWS):
        band = slice(first, first + _BAND_ROWS)
        for channel, word in enumerate(pcg3d(x, y[band], key[2:])):
            low = table.take(word & np.uint32(0xFFFF))
            variates[band, :, channel] = (low + table.take(word >> np.uint32(16))) * _SQRT_HALF
    return variates


_SQRT_HALF = np.float32(np.sqrt(0.5))
# Rows whose arrays stay in the processor's cache: 0.6 of the time of 640 x 480 px at once.
_BAND_ROWS = 32

_NUM_QUANTILES = 2**16


@cache
def normal_quantile_table() -> npt.NDArray[np.float32]:
    """Quantiles (i + 1/2) / 2^16 of the normal distribution, (2^16,), scaled to unit variance."""
    from statistics import NormalDist

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
