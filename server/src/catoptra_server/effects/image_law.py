"""The camera law next to each pixel's middle: how a pixel moves when what it shows turns or comes.

A unit direction d that changes by dd moves its pixel by J dd, J the (2, 3) derivative of the camera
law: along * radial unit * e_theta + across * tangential unit * e_phi, the scales in px a radian. A
turn w of what is seen changes d by w x d, so J (w x d) = (d x J_u, d x J_v) w. These maps are all
that a shader of motion is told of the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import (
    OmniCamera,
    direction_from_pixel,
    half_angle_tangent,
    pixel_centres,
)
from catoptra_protocol.optics.numerics import Bools, Floats

Float32s = npt.NDArray[np.float32]

# How a pixel stands to the mirror: its middle sees none; the rim goes through it, or nearly; all of
# it sees the mirror; so does all that is within two pixels of it, where light is interpolated.
BESIDE, AT_RIM, WHOLE, INNER = range(4)
# From a pixel's middle to its corner, and to the farthest corner of what light is interpolated of.
_WHOLE_PX, _INNER_PX = 0.71, 0.71 + 5**0.5


@dataclass(frozen=True, slots=True, eq=False)
class ImageLaw:
    """Maps of all pixels, (h, w, 3) float32, read-only, in mirror axes; zero beside the mirror.

    to_u, to_v: px a unit of what is added to a unit direction. about_u, about_v: px a radian about
    each axis. standing: (h, w, 1), BESIDE to INNER.
    """

    to_u: Float32s
    to_v: Float32s
    about_u: Float32s
    about_v: Float32s
    standing: Float32s


@lru_cache(maxsize=4)
def image_law(camera: OmniCamera) -> ImageLaw:
    """Return the law of a camera's pixels."""
    directions, on_mirror = direction_from_pixel(camera, pixel_centres(camera)[..., 0, :])
    to_u, to_v = _rows(camera, directions)
    maps = (to_u, to_v, np.cross(directions, to_u), np.cross(directions, to_v), _standing(camera))
    return ImageLaw(*(_map(values, on_mirror) for values in maps))


def _standing(camera: OmniCamera) -> Floats:
    """Return (h, w, 1) how pixels stand to the mirror, where their middles see it."""
    place = pixel_centres(camera)[..., 0, :]
    to_rim = camera.rim_radius_px - np.linalg.norm(place - camera.centre_px, axis=-1)
    to_border = np.minimum(place, (camera.width_px, camera.height_px) - place).min(axis=-1)
    standing = np.where(to_rim > _WHOLE_PX, WHOLE, AT_RIM)
    standing[(to_rim > _INNER_PX) & (to_border > 2.0)] = INNER
    return standing[..., None].astype(np.float64)


def _rows(camera: OmniCamera, directions: Floats) -> tuple[Floats, Floats]:
    """Return the rows of J. On the axis both scales are equal, and any azimuth is right."""
    x, y, z = np.moveaxis(directions, -1, 0)
    sine = np.hypot(x, y)
    off_axis = sine > 0.0
    divisor = np.where(off_axis, sine, 1.0)
    cos_phi, sin_phi = np.where(off_axis, x / divisor, 1.0), y / divisor
    along, across = _scales(camera, directions, divisor)
    e_theta = np.stack((z * cos_phi, z * sin_phi, -sine), axis=-1)
    e_phi = np.stack((-sin_phi, cos_phi, np.zeros_like(z)), axis=-1)
    ca, sa = math.cos(camera.up_azimuth_rad), math.sin(camera.up_azimuth_rad)
    out = sa * cos_phi - ca * sin_phi, -ca * cos_phi - sa * sin_phi
    round_ = -sa * sin_phi - ca * cos_phi, ca * sin_phi - sa * cos_phi
    to_u, to_v = (
        (along * radial)[..., None] * e_theta + (across * tangential)[..., None] * e_phi
        for radial, tangential in zip(out, round_, strict=True)
    )
    return to_u, to_v


def _scales(camera: OmniCamera, directions: Floats, sine: Floats) -> tuple[Floats, Floats]:
    """Return px a radian along the image radius and across it; sine: not 0."""
    t = half_angle_tangent(directions)[0]
    along = camera.horizon_radius_px * camera.mirror.radius_ratio_slope(t)
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
    # Next to the axis both scales agree to the square of the angle, so to every digit.
    return along, np.where(t > 1e-9, radius_px / sine, along)


def _map(values: Floats, on_mirror: Bools) -> Float32s:
    chart: Float32s = np.where(on_mirror[..., None], values, 0.0).astype(np.float32)
    chart.setflags(write=False)
    return chart
