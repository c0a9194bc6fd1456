"""Light: ends of the sRGB curve, sums of samples in linear light, point lights near and far."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.reference import reference_engine as ray_batches
from catoptra_server.world import shading
from catoptra_server.world import world_description as colour
from catoptra_server.world.world_description import PointLight


def _encode(linear: float) -> Floats:
    return colour.srgb_from_linear(np.array(linear))


def _greys(red: list[float], samples: int) -> list[int]:
    """Greys of a pixel: red cycles through the list, green is full, blue dark."""
    side = math.isqrt(samples)
    pixel = np.zeros((samples, 3))
    pixel[:, 0], pixel[:, 1] = np.resize(np.array(red), samples), 1.0
    # Sixteen pixels of the same samples, in blocks of 4 x 4 rays.
    grid = np.tile(pixel.reshape(side, side, 3), (4, 4, 1))
    blocks = grid.reshape(side, 4, side, 4, 3).swapaxes(1, 2).reshape(1, samples, 16, 3)
    return [int(level) for level in ray_batches.encode_pixels(blocks, side)[0, 0, 0]]


def _irradiance(height_m: float) -> float:
    lamp = PointLight((0.0, 0.0, -height_m), (1.0, 1.0, 1.0))
    floor, up = np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]])
    return float(shading.point_irradiance((lamp,), floor, up)[0, 0])


SUBJECTS = {
    "srgb_from_linear": _encode,
    "sample_sums": _greys,
    "point_irradiance": _irradiance,
}
