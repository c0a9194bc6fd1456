"""Cameras to be written as calibration files and read again."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    KannalaBrandtLens,
    OCamLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture

PAPER = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120.0)
)
THETA_BACK = OmniCamera(
    UnifiedLens(1.19807, -0.25709, 0.01283),
    960,
    1080,
    (480.0, 540.0),
    620.3,
    math.radians(110.0),
    0.0,
    Picture.FLIPPED,
    ImagePlane((1.0, 0.002, 0.0, 1.01), 1e-3, -5e-4),
)
TUM_VI = OmniCamera(
    DoubleSphereLens(-0.17213, 0.59312),
    512,
    512,
    (255.461, 257.389),
    158.286,
    math.radians(97.0),
    0.0,
    Picture.FLIPPED,
    ImagePlane((1.0, 0.0, 0.0, 158.274 / 158.286)),
)
TUM_VI_KB = OmniCamera(
    KannalaBrandtLens(0.00348239, 0.00071503, -0.00205324, 0.00020294),
    512,
    512,
    (255.43, 257.4),
    190.978,
    math.radians(97.0),
    0.0,
    Picture.FLIPPED,
)
LAFIDA = OmniCamera(
    OCamLens((209.2008, 0.0, -0.00213742, 4.22036e-6, -1.771461e-8)),
    754,
    480,
    (370.0, 240.0),
    1.0,
    math.radians(90.0),
    0.0,
    Picture.FLIPPED,
    ImagePlane((1.0, 1e-4, 2e-4, 1.0003)),
)
WOODSCAPE = OmniCamera(
    WoodScapeLens(339.749, -31.988, 48.275, -7.201),
    1280,
    966,
    (643.942, 479.907),
    1.0,
    math.radians(95.0),
    0.0,
    Picture.FLIPPED,
    ImagePlane((1.0, 0.0, 0.0, 1.01)),
)


def flipped_points(camera: OmniCamera) -> tuple[Floats, Floats, Bools]:
    """Points (n, 3) in the calibration frame (x right, y down, z forward), their pixels in the
    flipped picture with the first pixel's centre at 0, and validity: 1e5 directions, rim included.
    """
    rng = np.random.default_rng(7)
    theta = np.append(rng.uniform(0.0, camera.rim_rad, 99_900), np.full(100, camera.rim_rad))
    azimuth = rng.uniform(-math.pi, math.pi, len(theta))
    sine = np.sin(theta)
    points = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)), axis=-1)
    # The mirror frame with the image's top along +x: x = -down, y = right.
    up = camera.image_up_azimuth_rad
    x, y = -points[:, 1], points[:, 0]
    turned = (x * math.cos(up) - y * math.sin(up), x * math.sin(up) + y * math.cos(up))
    direction = np.stack((*turned, points[:, 2]), axis=-1)
    pixel, valid = camera.with_picture(Picture.FLIPPED).pixel_from_direction(direction)
    return points, pixel - 0.5, valid
