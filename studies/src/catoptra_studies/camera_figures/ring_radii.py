"""Radii of the incidence rings in an image, from pixels alone and without the camera model.

The image is sampled along straight lines from its centre. A ring is a dark interval of a line, and
its radius is the centroid of the darkness there.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_studies.plot_style import Image

NUM_SECTORS = 24
# One line is good to 0.2 px, since the pixels alias a ring that is hardly wider than they are; the
# mean of a sector's lines removes most of that.
_LINES_PER_SECTOR = 15
_STEP_PX = 0.05
# A twentieth of full contrast, below which there is only the white between the rings.
_DARKNESS_THRESHOLD = 0.05
# The black outside reaches two pixels inwards: one by interpolation, one in the rim's own pixel.
_RIM_MARGIN_PX = 2.0


def measure_ring_radii(image: Image, *, rim_radius_px: float) -> Floats:
    """Measure the radii of all rings about the image's centre.

    Args:
        image: Frame of dark rings on white.
        rim_radius_px: Radius of the mirror's rim; the search ends just before.

    Returns:
        (NUM_SECTORS, rings) radii in pixels, from the inmost ring outwards.

    Raises:
        CatoptraError: Not every line crosses the same number of rings.
    """
    # Green is dark in the grey rings and in the red one. Linear light, because a pixel averages
    # light, and the centroid of an encoded average would be displaced.
    intensity = linear_from_srgb(image[..., 1] / 255.0)
    radius = np.arange(0.0, rim_radius_px - _RIM_MARGIN_PX, _STEP_PX)
    num_lines = NUM_SECTORS * _LINES_PER_SECTOR
    azimuth = 2.0 * math.pi * (np.arange(num_lines) + 0.5) / num_lines
    u = 0.5 * image.shape[1] + np.outer(np.cos(azimuth), radius)
    v = 0.5 * image.shape[0] + np.outer(np.sin(azimuth), radius)
    darkness = 1.0 - _interpolate(intensity, u, v) / intensity.max()
    centroids = [_centroids(radius, line) for line in darkness]
    counts = {len(line) for line in centroids}
    if len(counts) != 1 or not min(counts):
        raise CatoptraError(
            f"{min(counts)} to {max(counts)} rings found along {num_lines} lines in an image "
            f"{image.shape[1]} px wide: --rings-world must be a world of closed rings around the "
            "robot's first start, such as configs/worlds/incidence_rings.ini"
        )
    radii: Floats = np.array(centroids).reshape(NUM_SECTORS, _LINES_PER_SECTOR, -1).mean(axis=1)
    return radii


def _centroids(radius: Floats, darkness: Floats) -> Floats:
    """Centroid of every dark interval that lies wholly on the line."""
    # A False at both ends makes every interval begin and end inside the array.
    is_dark = np.concatenate(([False], darkness > _DARKNESS_THRESHOLD, [False]))
    begins = np.flatnonzero(is_dark[1:] & ~is_dark[:-1])
    ends = np.flatnonzero(is_dark[:-1] & ~is_dark[1:])
    is_whole = (begins > 0) & (ends < len(radius))
    intervals = [slice(b, e) for b, e in zip(begins[is_whole], ends[is_whole], strict=True)]
    return np.array(
        [np.average(radius[interval], weights=darkness[interval]) for interval in intervals]
    )


def _interpolate(intensity: Floats, u: Floats, v: Floats) -> Floats:
    """Bilinear interpolation between pixel centres, which are at +0.5, at (...) positions."""
    column, row = np.floor(u - 0.5).astype(int), np.floor(v - 0.5).astype(int)
    a, b = u - 0.5 - column, v - 0.5 - row
    upper = (1.0 - a) * intensity[row, column] + a * intensity[row, column + 1]
    lower = (1.0 - a) * intensity[row + 1, column] + a * intensity[row + 1, column + 1]
    value: Floats = (1.0 - b) * upper + b * lower
    return value
