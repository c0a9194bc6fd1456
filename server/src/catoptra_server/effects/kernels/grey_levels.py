"""How far a change of linear light moves an encoded pixel, in grey levels of 255.

Criteria speak of what is seen: the sRGB curve is 13 times as steep in the dark as a straight line
and 0.4 times as steep in white, so a linear bound would be wrong by as much.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.colour import srgb_from_linear

_NUM_RADIANCES = 2049


def grey_level(radiance: float) -> float:
    """Return the grey level of linear light, not rounded."""
    return 255.0 * float(srgb_from_linear(np.array(radiance)))


def max_change_by_gain(gain: float, max_radiance: float) -> float:
    """Return the largest change of any light from 0 to `largest` that is multiplied by a gain.

    Darkened, the brightest light that is not clipped changes most; brightened, what just reaches
    white.
    """
    if gain <= 1.0:
        bright = min(max_radiance, 1.0)
        return grey_level(bright) - grey_level(gain * bright)
    just_white = min(max_radiance, 1.0 / gain)
    return grey_level(gain * just_white) - grey_level(just_white)


def max_change_by_offset(offset: Callable[[Floats], Floats], max_radiance: float) -> float:
    """Return the largest change of any light from 0 to `largest` that gains or loses an offset.

    Domain: offsets that do not shrink as light grows, by less than light does. Looked for on a grid
    that is fine in the dark; between its places a smooth offset gives no 1000th more.
    """
    top = min(max_radiance, 1.0)
    light = np.concatenate(([0.0], np.geomspace(1e-7, 1.0, _NUM_RADIANCES) * top))
    off = offset(light)
    levels = 255.0 * srgb_from_linear(np.stack((light, light + off, light - off)))
    return float(np.abs(levels[1:] - levels[0]).max())
