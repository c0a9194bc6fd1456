"""Diameters of an effect's discs, measured in images of the pixel coordinates themselves."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import CaptureContext, ImageEffect


def measure_blur_diameters_px(
    effect: ImageEffect, camera: OmniCamera, capture: CaptureContext
) -> Floats:
    """Diameter of the disc whose mean each pixel is, (h, w), by the variance.

    A uniform disc of diameter d has the variance d^2 / 16 along each axis, and the mean of u^2 is
    that plus the squared mean of u: the image (u, u^2, 0) has both moments of each pixel.
    """
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    variances = []
    for at in (u, v):
        moments = effect.apply(np.stack((at, at * at, 0.0 * at), axis=-1), camera, capture)
        variances.append(moments[..., 1] - np.square(moments[..., 0]))
    return 4.0 * np.sqrt(np.maximum(0.5 * (variances[0] + variances[1]), 0.0))


def inner_pixels(camera: OmniCamera, margin_px: float) -> np.ndarray[tuple[int, int]]:
    """Pixels, (h, w), at least a margin inside the rim."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    return np.hypot(u[None, :], v[:, None]) < camera.rim_radius_px - margin_px


def make_point_source(camera: OmniCamera, row: int, column: int) -> Floats:
    """Black image with one pixel of radiance 1."""
    image = np.zeros((camera.height_px, camera.width_px, 3))
    image[row, column] = 1.0
    return image
