"""Errors as colours: white where there is none, through yellow and red to black where it is large.

Errors of a ladder span decades, so the scale is logarithmic: below its least all is white.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image

# Falling brightness all the way, so that the order is seen in grey, too.
_COLOUR_STOPS = np.array(
    [(255, 255, 255), (255, 236, 160), (250, 160, 60), (209, 41, 61), (110, 10, 70), (20, 8, 30)],
    dtype=np.float64,
)


def map_error_colours(errors: Floats, min_error: float, max_error: float) -> Image:
    """Return (..., 3) colours of (...) errors on a logarithmic scale; beyond its ends the ends'."""
    span = math.log(max_error / min_error)
    place = np.log(np.maximum(errors, min_error) / min_error) / span
    stops = np.linspace(0.0, 1.0, len(_COLOUR_STOPS))
    channels = [np.interp(place, stops, channel) for channel in _COLOUR_STOPS.T]
    colours: Image = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return colours


def colour_bar(width_px: int, height_px: int, min_error: float, max_error: float) -> Image:
    """Return the picture of the scale itself, from left to right."""
    along = np.geomspace(min_error, max_error, width_px)
    return np.repeat(map_error_colours(along, min_error, max_error)[None], height_px, axis=0)
