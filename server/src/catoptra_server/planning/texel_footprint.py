"""How large the texels of the cube's faces are in the image, and how large at the viewpoint.

A face is flat and the mirror is not, and parts of faces have texels of their own, so every place of
the image has another size of texel. It follows from two derivatives: of the image by the direction
(the mirror's law), and of the place on a face's plane by the direction. Turned into texels and
pixels they are a 2 x 2 matrix a place; its singular values are the pixels that a texel spans in the
directions in which it spans most and least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face, face_from_direction
from catoptra_protocol.optics.image_scale import ImageScale, compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.face_region import FaceRegion

# From the middle of the forward face to its right edge: the other side faces have the same parts,
# each with a left half like its right one, so the other seven eighths of the turn repeat.
_AZIMUTHS_RAD = np.linspace(0.0, 0.25 * math.pi, 33)
# Places on the border of two parts are in both: rounding must not put them into neither.
_BORDER_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class TexelFootprint:
    """Of the texels over the image: how large they are, and how many there are to a pixel.

    max, rms: in the direction in which a texel is largest at its place. min, median and max number
    a pixel: in the direction with fewest, in the mean of both, in that with most.
    """

    max_px: float
    rms_px: float
    max_rad: float
    rms_rad: float
    min_texels_per_px: float
    median_texels_per_px: float
    max_texels_per_px: float


@lru_cache(maxsize=64)
def texel_footprint(camera: OmniCamera, regions: tuple[FaceRegion, ...]) -> TexelFootprint:
    """Return the texels of parts of faces over what the image shows of the mirror."""
    scale = compute_image_scale(camera)
    weight = np.broadcast_to(scale.area_weight[:, None], (len(scale.t), len(_AZIMUTHS_RAD)))
    by_angle = _texels_per_rad(scale, regions)
    by_pixel = by_angle / np.stack((scale.radial, scale.tangential), axis=-1)[:, None, None]
    fewest, most = _singular_values(by_pixel)
    fewest_by_angle, _ = _singular_values(by_angle)
    return TexelFootprint(
        max_px=float(1.0 / fewest.min()),
        rms_px=_weighted_rms(1.0 / fewest, weight),
        max_rad=float(1.0 / fewest_by_angle.min()),
        rms_rad=_weighted_rms(1.0 / fewest_by_angle, weight),
        min_texels_per_px=float(fewest.min()),
        median_texels_per_px=_weighted_median(np.sqrt(fewest * most), weight),
        max_texels_per_px=float(most.max()),
    )


def _texels_per_rad(scale: ImageScale, regions: tuple[FaceRegion, ...]) -> Floats:
    """Return (rings, azimuths, 2, 2): texels (rows) an angle along and across a ring (columns)."""
    t, azimuth = np.meshgrid(scale.t, _AZIMUTHS_RAD, indexing="ij")
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
    # (s, t) = local[1:] / local[0], and the quotient rule.
    place = local[..., 1:] / local[..., :1]
    by_angle = (steps[..., 1:, :] - place[..., None] * steps[..., :1, :]) / local[..., :1, None]
    texels: Floats = by_angle * _texels_per_unit(face, place, regions)[..., None]
    return texels


def _texels_per_unit(
    face: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    points: Floats,
    regions: tuple[FaceRegion, ...],
) -> Floats:
    """Return (..., 2) columns and rows a unit at (..., 2) places on (...) faces: the fewest of any
    part that has the place."""
    density = np.full(points.shape, np.inf)
    for part in regions:
        window = part.window
        low = np.array((window.left, window.top)) - _BORDER_TOLERANCE
        high = np.array((window.right, window.bottom)) + _BORDER_TOLERANCE
        inside = (face == part.face) & ((points >= low) & (points <= high)).all(axis=-1)
        of_part = np.array((part.columns_per_unit, part.rows_per_unit))
        density[inside] = np.minimum(density[inside], of_part)
    missing = sorted({Face(f).name for f in face[~np.isfinite(density).all(axis=-1)].tolist()})
    assert not missing, f"the mirror looks at places of {missing} that no part of the plan has"
    return density


def _singular_values(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the smaller and the larger singular values of (..., 2, 2) matrices."""
    squares = np.square(matrices).sum(axis=(-2, -1))
    area = np.abs(np.linalg.det(matrices))
    larger = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * area**2, 0.0))))
    return area / larger, larger


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values, axis=None)
    below = np.cumsum(weight.reshape(-1)[order])
    return float(values.reshape(-1)[order][np.searchsorted(below, 0.5 * below[-1])])


def _weighted_rms(values: Floats, weight: Floats) -> float:
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))
