"""The light that was carried to pixels: read from where it was, as far as the mirror reaches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.cubic import cubic_aside
from catoptra_server.effects.effect import Real
from catoptra_server.effects.image_law import INNER, WHOLE
from catoptra_server.effects.image_motion import ImageMotion, Whole


def moved_light(
    table: npt.NDArray[Real], motion: ImageMotion[Real], pixels: Whole, aside: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    """Return the (n, 3) light (2, n) px aside of pixels; table: `cubic.with_differences`.

    At the rim, where interpolation would take in what is beside the mirror, that of the next pixel;
    what would come from beyond the rim is unknown: a pixel keeps its own.
    """
    there, standing = motion.standing(pixels, aside)
    light = cubic_aside(table, pixels, aside, width=motion.width)
    at = np.flatnonzero(standing < INNER)
    if at.size:
        nearest = np.where(standing[at] == WHOLE, there[at], pixels[at])
        light[at] = table[nearest, :3]
    return light
