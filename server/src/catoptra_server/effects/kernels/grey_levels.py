"""Largest change of an encoded pixel, in grey levels of 255, for a change of linear radiance.

Criteria compare encoded values: the sRGB curve is 13 times as steep in the dark as a straight line
and 0.4 times as steep at white, so a bound in linear counts would be wrong by as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.world_description import srgb_from_linear

_NUM_RADIANCES = 2049


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


def max_change_by_shift(displacement_px: float, max_radiance: float) -> float:
    """Largest change of a pixel whose light is displaced, grey levels.

    A pixel is a mean over its square, and a square shifted by (dx, dy) shares all but
    1 - (1 - |dx|) (1 - |dy|) <= |dx| + |dy| with itself; the same is the weight of other pixels in
    a bilinear interpolation.

    Args:
        displacement_px: Largest displacement, in any direction.
        max_radiance: Radiances from 0 up to this one occur.
    """
    return max_change_by_exchange(min(1.0, math.sqrt(2.0) * displacement_px), max_radiance)


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


def max_change_by_offset(offset: Callable[[Floats], Floats], max_radiance: float) -> float:
    """Largest change, in grey levels, of any radiance that gains or loses an offset.

    Args:
        offset: Offset of each of (n,) radiances. Domain: offsets that grow with radiance, by less
            than radiance itself.
        max_radiance: Radiances from 0 up to this one occur.
    """
    brightest = min(max_radiance, 1.0)
    # Geometric spacing is fine in the dark, where the sRGB curve is steepest; between two of these
    # radiances a smooth offset changes the result by less than a thousandth.
    radiance = np.concatenate(([0.0], np.geomspace(1e-7, 1.0, _NUM_RADIANCES) * brightest))
    shift = offset(radiance)
    levels = 255.0 * srgb_from_linear(np.stack((radiance, radiance + shift, radiance - shift)))
    return float(np.abs(levels[1:] - levels[0]).max())
