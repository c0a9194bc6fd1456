"""How many pixels a radian takes in the image, and which part of the mirror the image shows.

The law of a central mirror scales a small angle by dr/dtheta along the image radius and by r /
sin(theta) across it. Both grow from the middle to the rim, nearly alike: the law is nearly
conformal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

# Scales are smooth in the radius: 128 steps find their largest value to 1e-4.
_NUM_RINGS = 129


@dataclass(frozen=True, slots=True, eq=False)
class ImageScale:
    """Scales on rings of the visible mirror; (n,) arrays.

    t: tan(theta / 2) of the rings. along, across: px a radian along the radius and across it.
    weight: the part of the image that each ring stands for; sums to 1.
    """

    t: Floats
    radial: Floats
    tangential: Floats
    area_weight: Floats

    @property
    def max_px_per_rad(self) -> float:
        """Return the largest scale, in any direction."""
        return float(np.maximum(self.radial, self.tangential).max())

    @property
    def rms_px_per_rad(self) -> float:
        """Return the rms over the image and all directions."""
        mean = 0.5 * (np.square(self.radial) + np.square(self.tangential))
        return math.sqrt(float(mean @ self.area_weight))


def compute_image_scale(camera: OmniCamera) -> ImageScale:
    """Return the scales of the rings that the image shows, from the innermost to the outermost."""
    nearest, farthest = visible_radii_px(camera)
    radius_px = np.linspace(nearest, farthest, _NUM_RINGS)
    horizon_px = camera.horizon_radius_px
    if nearest < horizon_px < farthest:
        # The side faces' middles are there: their texels are the largest.
        radius_px = np.sort(np.append(radius_px, horizon_px))
    t = camera.mirror.t_from_radius_ratio(radius_px / horizon_px)
    along = horizon_px * camera.mirror.radius_ratio_slope(t)
    on_axis = t < 1e-9  # both scales are equal there, and r / sin(theta) has no value
    sine = np.where(on_axis, 1.0, 2.0 * t / (1.0 + np.square(t)))
    across = np.where(on_axis, along, radius_px / sine)
    area = np.gradient(np.square(radius_px))
    return ImageScale(t, along, across, area / area.sum())


def visible_radii_px(camera: OmniCamera) -> tuple[float, float]:
    """Return the smallest and the largest image radius of the mirror within the image."""
    size = (camera.width_px, camera.height_px)
    sides = tuple(zip(camera.centre_px, size, strict=True))
    nearest = math.hypot(*(max(-place, 0.0, place - length) for place, length in sides))
    farthest = math.hypot(*(max(abs(place), abs(length - place)) for place, length in sides))
    return min(nearest, camera.rim_radius_px), min(farthest, camera.rim_radius_px)


def shows_whole_rim(camera: OmniCamera) -> bool:
    """Return whether no part of the mirror lies beyond the image's borders."""
    # A part in 1e9 for rim circles that touch the borders up to their own rounding.
    radius = camera.rim_radius_px * (1.0 - 1e-9)
    (u, v), width, height = camera.centre_px, camera.width_px, camera.height_px
    return min(u, v, width - u, height - v) >= radius
