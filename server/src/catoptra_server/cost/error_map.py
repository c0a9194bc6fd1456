"""Errors as colours: white where there is none, through yellow and red to black where it is large.

Errors of a ladder span decades, so the scale is logarithmic: below its least all is white.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image

# Falling brightness all the way, so that the order is seen in grey, too.
_STOPS = np.array(
    [(255, 255, 255), (255, 236, 160), (250, 160, 60), (209, 41, 61), (110, 10, 70), (20, 8, 30)],
    dtype=np.float64,
)


def error_colours(errors: Floats, least: float, largest: float) -> Image:
    """Return (..., 3) colours of (...) errors on a logarithmic scale; beyond its ends the ends'."""
    span = math.log(largest / least)
    place = np.log(np.maximum(errors, least) / least) / span
    stops = np.linspace(0.0, 1.0, len(_STOPS))
    channels = [np.interp(place, stops, channel) for channel in _STOPS.T]
    colours: Image = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return colours


def scale_bar(width_px: int, height_px: int, least: float, largest: float) -> Image:
    """Return the picture of the scale itself, from left to right."""
    along = np.geomspace(least, largest, width_px)
    return np.repeat(error_colours(along, least, largest)[None], height_px, axis=0)
