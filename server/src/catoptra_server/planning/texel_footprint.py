"""Footprint of the texels of cube faces, in the image and as angles at the viewpoint.

A face is flat, the mirror is not, and regions have densities of their own, so the size of a texel
varies over the image. Two derivatives give the size: that of the image position by the direction
(the camera model), and that of the position on a face's plane by the direction. In texels and
pixels they form a 2 x 2 matrix at each pixel; the inverses of its singular values are the longest
and the shortest extent of a texel in pixels.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face, face_from_direction
from catoptra_protocol.optics.image_scale import ImageScale, compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.renderer import FaceRegion

# From the centre of the forward face to the right edge: the other side faces have the same regions,
# each symmetric, so the other seven eighths of the turn repeat.
_AZIMUTHS_RAD = np.linspace(0.0, 0.25 * math.pi, 33)
# Points on the border of two regions belong to both: rounding must not put them into neither.
_BORDER_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class TexelFootprint:
    """Size of texels, and their density, over the visible image."""

    max_px: float
    """Longest extent of a texel."""
    rms_px: float
    """Root mean square of the longest extents."""
    max_rad: float
    """Longest extent as an angle."""
    rms_rad: float
    """Root mean square of the longest extents as angles."""
    min_texels_per_px: float
    """Smallest over the image, in the direction of the smaller density."""
    median_texels_per_px: float
    """Of the geometric mean of both directions."""
    max_texels_per_px: float
    """Largest over the image, in the direction of the larger density."""


@lru_cache(maxsize=64)
def texel_footprint(camera: OmniCamera, regions: tuple[FaceRegion, ...]) -> TexelFootprint:
    """Footprint of the texels of face regions, over the image of the mirror."""
    scale = compute_image_scale(camera)
    weight = np.broadcast_to(scale.area_weight[:, None], (len(scale.t), len(_AZIMUTHS_RAD)))
    by_angle = _texels_per_rad(scale, regions)
    by_pixel = by_angle / np.stack((scale.radial, scale.tangential), axis=-1)[:, None, None]
    smallest, largest = _singular_values(by_pixel)
    smallest_by_angle, _ = _singular_values(by_angle)
    return TexelFootprint(
        max_px=float(1.0 / smallest.min()),
        rms_px=_weighted_rms(1.0 / smallest, weight),
        max_rad=float(1.0 / smallest_by_angle.min()),
        rms_rad=_weighted_rms(1.0 / smallest_by_angle, weight),
        min_texels_per_px=float(smallest.min()),
        median_texels_per_px=_weighted_median(np.sqrt(smallest * largest), weight),
        max_texels_per_px=float(largest.max()),
    )


def _texels_per_rad(scale: ImageScale, regions: tuple[FaceRegion, ...]) -> Floats:
    """(rings, azimuths, 2, 2): texels in columns and rows (row) an angle along and across a ring
    (column)."""
    t, azimuth = np.meshgrid(scale.t, _AZIMUTHS_RAD, indexing="ij")
    # cos and sin of the incidence angle from t = tan(theta / 2), without cancellation near the
    # horizon.
    cosine = (1.0 - t) * (1.0 + t) / (1.0 + t * t)
    sine = 2.0 * t / (1.0 + t * t)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    direction = np.stack((sine * ca, sine * sa, cosine), axis=-1)
    along = np.stack((cosine * ca, cosine * sa, -sine), axis=-1)
    across = np.stack((-sa, ca, np.zeros_like(sa)), axis=-1)
    face = face_from_direction(direction)
    local = np.einsum("...i,...ij->...j", direction, MIRROR_FROM_FACE_ROTATIONS[face])
    steps = np.einsum(
        "k...i,...ij->...jk", np.stack((along, across)), MIRROR_FROM_FACE_ROTATIONS[face]
    )
    # (s, t) = local[1:] / local[0], differentiated by the quotient rule.
    point = local[..., 1:] / local[..., :1]
    by_angle = (steps[..., 1:, :] - point[..., None] * steps[..., :1, :]) / local[..., :1, None]
    texels: Floats = by_angle * _texels_per_unit(face, point, regions)[..., None]
    return texels


def _texels_per_unit(
    face: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    points: Floats,
    regions: tuple[FaceRegion, ...],
) -> Floats:
    """(..., 2) columns and rows a unit at (..., 2) points on (...) faces; the lowest of any region
    there."""
    density = np.full(points.shape, np.inf)
    for region in regions:
        window = region.window
        low = np.array((window.left, window.top)) - _BORDER_TOLERANCE
        high = np.array((window.right, window.bottom)) + _BORDER_TOLERANCE
        inside = (face == region.face) & ((points >= low) & (points <= high)).all(axis=-1)
        of_region = np.array((region.columns_per_unit, region.rows_per_unit))
        # A sample on a seam may read either region: the coarser one is the bound.
        density[inside] = np.minimum(density[inside], of_region)
    missing = sorted({Face(f).name for f in face[~np.isfinite(density).all(axis=-1)].tolist()})
    assert not missing, f"no region of the plan covers all visible points of the faces {missing}"
    return density


def _singular_values(matrices: Floats) -> tuple[Floats, Floats]:
    """Smaller and larger singular values of (..., 2, 2) matrices, in closed form."""
    squares = np.square(matrices).sum(axis=(-2, -1))
    # Their product is |det|, the sum of their squares the Frobenius norm squared: two equations for
    # both.
    area = np.abs(np.linalg.det(matrices))
    larger = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * area**2, 0.0))))
    return area / larger, larger


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values, axis=None)
    below = np.cumsum(weight.reshape(-1)[order])
    return float(values.reshape(-1)[order][np.searchsorted(below, 0.5 * below[-1])])


def _weighted_rms(values: Floats, weight: Floats) -> float:
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))
