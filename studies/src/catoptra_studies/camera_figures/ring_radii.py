"""Find the rings of incidence in a picture: from pixels alone, without knowing the law.

The picture is read along straight lines from its centre; a ring is where it is darker than its
surroundings, and its radius is the centroid of that darkness. A single line is good to 0.2 px,
because pixels alias a ring that is hardly wider than they are; lines are averaged over sectors.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image
from catoptra_server.scene.colour import linear_from_srgb

NUM_SECTORS = 24
_LINES_PER_SECTOR = 15
_STEP_PX = 0.05
# A twentieth of full contrast: below it lies nothing but the paper between the rings.
_DARKNESS_THRESHOLD = 0.05
# The rim's black edge darkens pixels up to two from it, by the read and by the pixel itself.
_RIM_MARGIN_PX = 2.0


def measure_ring_radii(image: Image, *, rim_radius_px: float) -> Floats:
    """Return (SECTORS, rings) radii in pixels, inmost first, about the middle of the picture.

    Raises CatoptraError where a ring cannot be told from its neighbours along every line.
    """
    # Green is dark in grey rings and in the red one.
    light = linear_from_srgb(image[..., 1] / 255.0)
    radius = np.arange(0.0, rim_radius_px - _RIM_MARGIN_PX, _STEP_PX)
    lines = NUM_SECTORS * _LINES_PER_SECTOR
    azimuth = 2.0 * math.pi * (np.arange(lines) + 0.5) / lines
    u = 0.5 * image.shape[1] + np.outer(np.cos(azimuth), radius)
    v = 0.5 * image.shape[0] + np.outer(np.sin(azimuth), radius)
    darkness = 1.0 - _interpolate(light, u, v) / light.max()
    found = [_centroids(radius, line) for line in darkness]
    counts = {len(line) for line in found}
    if len(counts) != 1 or not min(counts):
        raise CatoptraError(
            f"{min(counts)} to {max(counts)} rings found along {lines} lines in a picture "
            f"{image.shape[1]} px wide: --rings-world must be a world of closed rings around the "
            "robot's first start, such as configs/worlds/incidence_rings.ini"
        )
    radii: Floats = np.array(found).reshape(NUM_SECTORS, _LINES_PER_SECTOR, -1).mean(axis=1)
    return radii


def _centroids(radius: Floats, darkness: Floats) -> Floats:
    """Return the centroid of every whole run of darkness along a line."""
    dark = np.concatenate(([False], darkness > _DARKNESS_THRESHOLD, [False]))
    begins = np.flatnonzero(dark[1:] & ~dark[:-1])
    ends = np.flatnonzero(dark[:-1] & ~dark[1:])
    whole = (begins > 0) & (ends < len(radius))
    runs = [slice(b, e) for b, e in zip(begins[whole], ends[whole], strict=True)]
    return np.array([np.average(radius[run], weights=darkness[run]) for run in runs])


def _interpolate(intensity: Floats, u: Floats, v: Floats) -> Floats:
    """Return an image's light at (...) places, interpolated linearly between pixel centres."""
    column, row = np.floor(u - 0.5).astype(int), np.floor(v - 0.5).astype(int)
    a, b = u - 0.5 - column, v - 0.5 - row
    upper = (1.0 - a) * intensity[row, column] + a * intensity[row, column + 1]
    lower = (1.0 - a) * intensity[row + 1, column] + a * intensity[row + 1, column + 1]
    read: Floats = (1.0 - b) * upper + b * lower
    return read
