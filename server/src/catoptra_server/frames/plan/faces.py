"""Regions of the cube's faces that a mirror sees, their texel densities, and a texel's footprint.

The image determines the density: where the mirror images one radian on R pixels radially and T
pixels tangentially, a step on a face covers a number of pixels, and a texel must not be longer than
one of them, or a fraction of one. Each face gets the window that the mirror sees, with as many
columns and rows as the densest pixel needs: 36 % fewer texels than faces of one size
(`tests/measurements/face_parts.py`). The bottom face, which the mirror shows smallest, needs a
third of the side of the side faces at the rim. Cutting the side faces at the horizon would save
another third; but triangles across the cut would be rendered twice, which costs a large scene more.

A face is flat, the mirror is not, and regions have densities of their own, so the size of a texel
varies over the image. Two derivatives give that footprint: of the image position by the direction
(the camera model), and of the position on a face's plane by the direction. In texels and pixels
they form a 2 x 2 matrix at each pixel; the inverses of the singular values are the longest and the
shortest extent of a texel in pixels.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    Face,
    face_coordinates,
    face_from_direction,
    visible_faces,
)
from catoptra_protocol.optics.image_plane import ImageScale, compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.plan.facet_error import max_by_radius, weighted_rms
from catoptra_server.render.renderer import FaceRegion, FaceWindow

# 512 MiB of linear light for all regions. The longest side leaves space for two regions in a
# texture of 16 384.
_MAX_TEXELS = 2**26
_MAX_SIDE_TEXELS = 2**13
# The density varies so slowly that the largest on a grid of this side is within 0.1 %.
_GRID_SIDE = 65
# Of a mirror the tangential density is near the radial one; of an equidistant lens it is four times
# the radial one at 142 degrees.
_MAX_TANGENTIAL = 4.0


def face_regions(
    camera: OmniCamera, max_incidence_rad: float, *, size_px: int, texels_per_px: float
) -> tuple[FaceRegion, ...]:
    """Regions up to an incidence angle.

    Args:
        size_px: Texels along a whole face; 0: by density.
        texels_per_px: Lowest density in the image, for regions by density.
    """
    if size_px:
        return _regions_of_size(max_incidence_rad, size_px)
    return _regions_by_density(camera, max_incidence_rad, texels_per_px=texels_per_px)


def max_face_size_px(regions: tuple[FaceRegion, ...]) -> int:
    """Side of a whole face in the finest region's texels."""
    return math.ceil(
        2.0 * max(max(region.columns_per_unit, region.rows_per_unit) for region in regions)
    )


def _regions_of_size(max_incidence_rad: float, size_px: int) -> tuple[FaceRegion, ...]:
    """Regions of all visible faces, with `size_px` texels for 90 degrees."""
    windows = {
        face: _visible_window(face, max_incidence_rad) for face in visible_faces(max_incidence_rad)
    }
    half = 0.5 * size_px
    return tuple(FaceRegion(f, w, half, half) for f, w in windows.items() if not w.is_empty)


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
    by_radius_px: tuple[float, ...]
    """Longest extent in each ring of a `facet_error.GeometricError`."""


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
        rms_px=weighted_rms(1.0 / smallest, weight),
        max_rad=float(1.0 / smallest_by_angle.min()),
        rms_rad=weighted_rms(1.0 / smallest_by_angle, weight),
        min_texels_per_px=float(smallest.min()),
        median_texels_per_px=_weighted_median(np.sqrt(smallest * largest), weight),
        max_texels_per_px=float(largest.max()),
        by_radius_px=max_by_radius(camera, scale.radius_px, 1.0 / smallest.min(axis=1)),
    )


# A start needs the regions of each camera three times: for limits of memory, and for the plan.
@lru_cache(maxsize=64)
def _regions_by_density(
    camera: OmniCamera, max_incidence_rad: float, *, texels_per_px: float
) -> tuple[FaceRegion, ...]:
    """Regions with the density that the image needs, up to an incidence angle.

    No texel is longer than a pixel over `texels_per_px`, unless the atlas would exceed _MAX_TEXELS
    or _MAX_SIDE_TEXELS: all are then coarser by one factor.
    """
    regions: list[FaceRegion] = []
    for region in _regions_of_size(max_incidence_rad, 2):
        if region.face in (Face.N, Face.C, Face.U):
            fitted = _fit_texel_density(camera, max_incidence_rad, region, texels_per_px)
        # Side faces are alike by the mirror's symmetry: N's density serves all four.
        regions.append(replace(fitted, face=region.face))
    return _limit_texels(tuple(regions))


def _visible_window(face: Face, max_incidence_rad: float) -> FaceWindow:
    """Smallest window of a face that contains all directions up to an incidence angle."""
    if face is Face.U:
        return FaceWindow()
    if face is Face.C:
        # The whole bottom face from 45 degrees on: the corners reach 54.7.
        half = math.tan(max_incidence_rad) if max_incidence_rad < 0.25 * math.pi else 1.0
        return FaceWindow(-half, -half, half, half)
    # On a side face t = cot(theta) / cos(azimuth from the centre): smallest in the centre below the
    # horizon, at the edge of the face, sqrt 2 farther, above.
    cotangent = 1.0 / math.tan(max_incidence_rad)
    highest = cotangent if cotangent > 0.0 else math.sqrt(2.0) * cotangent
    return FaceWindow(top=max(highest, -1.0))


def _fit_texel_density(
    camera: OmniCamera, max_incidence_rad: float, region: FaceRegion, texels_per_px: float
) -> FaceRegion:
    """Region with the texels of the densest point, rounded up to whole texels a face."""
    columns, rows = (
        0.5 * math.ceil(2.0 * texels_per_px * longest)
        for longest in _max_density(camera, max_incidence_rad, region)
    )
    return replace(region, columns_per_unit=columns, rows_per_unit=rows)


def _max_density(
    camera: OmniCamera, max_incidence_rad: float, region: FaceRegion
) -> tuple[float, float]:
    """Largest number of pixels that a unit of s and a unit of t cover within the mirror's view."""
    window = region.window
    grid = np.meshgrid(
        np.linspace(window.left, window.right, _GRID_SIDE),
        np.linspace(window.top, window.bottom, _GRID_SIDE),
    )
    points = np.concatenate(
        (np.stack(grid, axis=-1).reshape(-1, 2), _boundary_points(max_incidence_rad, region))
    )
    covered = _pixels_per_unit(camera, region.face, points)
    is_visible = (
        _incidence_rad(_directions_from_face_points(region.face, points))
        <= max_incidence_rad + 1e-9
    )
    columns, rows = covered[is_visible].max(axis=0)
    return float(columns), float(rows)


def _boundary_points(max_incidence_rad: float, region: FaceRegion) -> Floats:
    """(n, 2) points of a region's window on the circle of the largest incidence."""
    azimuth = np.linspace(-math.pi, math.pi, 8 * _GRID_SIDE + 1)
    ring = math.sin(max_incidence_rad)
    height = np.full_like(azimuth, math.cos(max_incidence_rad))
    circle = np.stack((ring * np.cos(azimuth), ring * np.sin(azimuth), height), axis=-1)
    # Points at the very edge of the hemisphere would have infinite face coordinates.
    ahead = circle[circle @ MIRROR_FROM_FACE_ROTATIONS[region.face][:, 0] > 1e-6]
    points = face_coordinates(ahead, np.full(len(ahead), region.face, dtype=np.intp))
    window = region.window
    low, high = (window.left, window.top), (window.right, window.bottom)
    inside: Floats = points[((points >= low) & (points <= high)).all(axis=-1)]
    return inside


def _pixels_per_unit(camera: OmniCamera, face: Face, points: Floats) -> Floats:
    """Pixels that a unit of s and a unit of t cover, at points on a face.

    A step perpendicular to a direction of length n moves the image by R / n radially and T / n
    tangentially. Beyond the rim, where only coarse meshes look, the density of the rim is used.

    Args:
        points: (n, 2) coordinates (s, t).

    Returns:
        (n, 2) pixels.
    """
    directions = _directions_from_face_points(face, points)
    x, y, z = directions.T
    rho, length = np.hypot(x, y), np.linalg.norm(directions, axis=-1)
    outwards = np.where(rho[:, None] > 0.0, directions[:, :2], (1.0, 0.0))
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    tangent = np.stack((-outwards[:, 1], outwards[:, 0], np.zeros_like(rho)), axis=-1)
    level, down = outwards * (z / length)[:, None], -rho / length
    radial_direction = np.concatenate((level, down[:, None]), axis=-1)
    radial, tangential = _pixels_per_radian(camera, np.arctan2(rho, z))
    steps = MIRROR_FROM_FACE_ROTATIONS[face][:, 1:]
    radial, tangential = radial / length, tangential / length
    covered: Floats = np.hypot(
        (radial_direction @ steps) * radial[:, None], (tangent @ steps) * tangential[:, None]
    )
    return covered


def _pixels_per_radian(camera: OmniCamera, incidence_rad: Floats) -> tuple[Floats, Floats]:
    """(n,) pixels a radian, radially and tangentially."""
    # On the axis both are equal; a millionth of a radian beside, their formulas have values.
    # A cone does not show the axis.
    lowest = max(1e-6, 2.0 * math.atan(camera.projection.t_min))
    theta = np.clip(incidence_rad, lowest, camera.rim_rad)
    t = np.tan(0.5 * theta)
    radial = camera.max_stretch * camera.radius_slope_px(t)
    tangential = camera.max_stretch * camera.radius_px_from_t(t) / np.sin(theta)
    # A lens that shows nearly everything stretches the antipode to a circle, for which no density
    # of texels suffices.
    return radial, np.minimum(tangential, _MAX_TANGENTIAL * float(radial.max()))


def _directions_from_face_points(face: Face, points: Floats) -> Floats:
    """(n, 3) directions of (n, 2) points in the mirror frame, one unit ahead of the face."""
    local = np.concatenate((np.ones((len(points), 1)), points), axis=-1)
    directions: Floats = local @ MIRROR_FROM_FACE_ROTATIONS[face].T
    return directions


def _incidence_rad(directions: Floats) -> Floats:
    x, y, z = directions.T
    return np.asarray(np.arctan2(np.hypot(x, y), z))


def _limit_texels(regions: tuple[FaceRegion, ...]) -> tuple[FaceRegion, ...]:
    """Regions coarsened by one factor, where texels or sides exceed the limits."""
    area_factor = _MAX_TEXELS / sum(region.num_texels for region in regions)
    side_factor = _MAX_SIDE_TEXELS / max(max(region.size_texels) for region in regions)
    # Texels grow with the square of the density, sides with the density.
    factor = min(1.0, math.sqrt(area_factor), side_factor)
    return tuple(
        replace(
            region,
            columns_per_unit=region.columns_per_unit * factor,
            rows_per_unit=region.rows_per_unit * factor,
        )
        for region in regions
    )


# From the centre of the forward face to the right edge: the other side faces have the same regions,
# each symmetric, so the other seven eighths of the turn repeat.
_AZIMUTHS_RAD = np.linspace(0.0, 0.25 * math.pi, 33)
# Points on the border of two regions belong to both: rounding must not put them into neither.
_BORDER_TOLERANCE = 1e-9


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
