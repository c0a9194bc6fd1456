"""Residual between two models of one camera, over its whole image."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.picture import Picture
from catoptra_protocol.slotted_dataclass import dataclass

_GRID = 317
"""Pixels along the image's sides: 1e5 in all."""


@dataclass(frozen=True, slots=True)
class Residual:
    """Difference of a model from the true one."""

    max_px: float
    rms_px: float
    max_deg: float
    rms_deg: float
    fraction_missing: float
    """Of the true model's image: pixels to which the other model assigns no direction."""


def compute_residual(truth: OmniCamera, model: OmniCamera) -> Residual:
    """Residual at a grid of pixels of the image, the border of its domain included."""
    truth, model = (camera.with_picture(Picture.FLIPPED) for camera in (truth, model))
    u = np.linspace(0.0, truth.width_px, _GRID)
    v = np.linspace(0.0, truth.height_px, _GRID)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    direction, valid = truth.direction_from_pixel(pixels)
    pixels, direction = pixels[valid], direction[valid]
    # The mirror frames may differ by the azimuth of the image's top.
    turned = _turn(direction, model.image_up_azimuth_rad - truth.image_up_azimuth_rad)
    found, shown = model.pixel_from_direction(turned)
    back, seen = model.direction_from_pixel(pixels)
    both = shown & seen
    if not both.any():
        return Residual(math.inf, math.inf, 180.0, 180.0, 1.0)
    px = np.linalg.norm(found - pixels, axis=-1)[both]
    # Of small angles the chord is exact where a cosine has no digits.
    chord = np.linalg.norm(back - turned, axis=-1)[both]
    deg = np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
    return Residual(
        float(px.max()),
        float(np.sqrt(np.mean(px**2))),
        float(deg.max()),
        float(np.sqrt(np.mean(deg**2))),
        1.0 - float(both.mean()),
    )


def _turn(direction: Floats, azimuth_rad: float) -> Floats:
    c, s = math.cos(azimuth_rad), math.sin(azimuth_rad)
    turned: Floats = direction @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return turned
