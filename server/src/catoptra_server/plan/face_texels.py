"""How large the texels of the cube's faces are in the image, and how large at the viewpoint.

A face is flat and the mirror is not, so a texel of the middle of a face takes more of the image
than one of its corner. What a texel is to the image follows from two derivatives: of the image by
the direction (the mirror's law) and of the face's plane by the direction. All numbers here are for
faces of 2 x 2 units, which is their size in s and t; a texel is 2 / face size of such a unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.cube import FACE_AXES, face_from_direction
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.plan.image_scale import ImageScale, image_scale

# Azimuths from the middle of a side face to its edge; the other seven eighths of the turn repeat.
_AZIMUTHS = np.linspace(0.0, 0.25 * math.pi, 33)


@dataclass(frozen=True, slots=True)
class FaceScale:
    """Of the units of the faces over the image: how large they are, and how many a pixel spans.

    max, rms: in the direction in which a unit is largest at its place. min, median and max number
    of units a pixel: in the direction with fewest, in the mean of both, in that with most.
    """

    max_px_per_unit: float
    rms_px_per_unit: float
    max_rad_per_unit: float
    rms_rad_per_unit: float
    min_units_per_px: float
    median_units_per_px: float
    max_units_per_px: float


@lru_cache(maxsize=64)
def face_scale(camera: OmniCamera) -> FaceScale:
    """Return the scales over the part of the mirror that the image shows."""
    scale = image_scale(camera)
    weight = np.broadcast_to(scale.weight[:, None], (len(scale.t), len(_AZIMUTHS)))
    by_angle = _units_per_rad(scale)
    by_pixel = by_angle / np.stack((scale.along, scale.across), axis=-1)[:, None, None]
    fewest, most = _singular_values(by_pixel)
    fewest_by_angle, _ = _singular_values(by_angle)
    return FaceScale(
        max_px_per_unit=float(1.0 / fewest.min()),
        rms_px_per_unit=_rms(1.0 / fewest, weight),
        max_rad_per_unit=float(1.0 / fewest_by_angle.min()),
        rms_rad_per_unit=_rms(1.0 / fewest_by_angle, weight),
        min_units_per_px=float(fewest.min()),
        median_units_per_px=_median(np.sqrt(fewest * most), weight),
        max_units_per_px=float(most.max()),
    )


def _units_per_rad(scale: ImageScale) -> Floats:
    """Return (rings, azimuths, 2, 2) derivatives of (s, t) by an angle along and across a ring."""
    t, azimuth = np.meshgrid(scale.t, _AZIMUTHS, indexing="ij")
    cosine = (1.0 - t) * (1.0 + t) / (1.0 + t * t)
    sine = 2.0 * t / (1.0 + t * t)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    direction = np.stack((sine * ca, sine * sa, cosine), axis=-1)
    along = np.stack((cosine * ca, cosine * sa, -sine), axis=-1)
    across = np.stack((-sa, ca, np.zeros_like(sa)), axis=-1)
    axes = FACE_AXES[face_from_direction(direction)]
    local = np.einsum("...i,...ij->...j", direction, axes)
    steps = np.einsum("...ki,...ij->...jk", np.stack((along, across), axis=-2), axes)
    forward = local[..., :1, None]
    # (s, t) = local[1:] / local[0]; the quotient rule.
    sideways = local[..., 1:, None] / forward
    derivative: Floats = (steps[..., 1:, :] - sideways * steps[..., :1, :]) / forward
    return derivative


def _singular_values(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the smaller and the larger singular values of (..., 2, 2) matrices."""
    squares = np.square(matrices).sum(axis=(-2, -1))
    area = np.abs(np.linalg.det(matrices))
    larger = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * area**2, 0.0))))
    return area / larger, larger


def _median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values, axis=None)
    below = np.cumsum(weight.reshape(-1)[order])
    return float(values.reshape(-1)[order][np.searchsorted(below, 0.5 * below[-1])])


def _rms(values: Floats, weight: Floats) -> float:
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))
