"""The image plane of a camera: from the projection's plane to pixels, beyond one scale for all.

The plane's axes are those of calibration files: x right, y down in the right-handed picture, seen
along the optical axis. A point of the projection lies at its image radius; a decentred lens
displaces it (p1, p2 of Brown's model), and a stretch maps it to pixels: unequal focal lengths and
skew of K in OpenCV, Kalibr and Mei, the affine matrix of OCamCalib, the aspect ratio of WoodScape.
The conventions of pixel coordinates, and the sample positions in a pixel, are here too. Source:
Brown 1966; Mei & Rives 2007; documentation of cv2.omnidir.

Scale of an image by its radius: a small angle is mapped by dr/dtheta along the image radius and by
r / sin(theta) across the radius. A central mirror's scales grow from the centre to the rim and stay
close to each other: the projection is nearly conformal. A flat image's are f / cos^2(theta) and f /
cos(theta).

Natural vignetting is the irradiance of the image of a scene of one radiance, relative to the axis.
A pinhole or thin lens loses cos^4 of the angle of its chief ray: a cosine for its aperture, seen
obliquely, three for the solid angle of a pixel. A wide-angle lens turns its entrance pupil towards
the ray, so that its aperture keeps its area, and only the solid angle of a pixel remains,
sin(theta) / (r dr/dtheta): 1 for an equisolid lens, whose pixels see equal solid angles. Source:
Reiss 1945; Slyusarev 1984.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import (
    arctan,
    cos,
    hypot,
    interpolate_linear,
    matmul,
    sin,
    tan,
)
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.radial_camera import RadialCamera, RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass


class ImageSize(Protocol):
    """Any camera model with an image size."""

    @property
    def width_px(self) -> int:
        """Number of columns."""

    @property
    def height_px(self) -> int:
        """Number of rows."""


def pixel_sample_positions(
    camera: ImageSize, samples_per_side: int = 1, *, rows: range | None = None
) -> Floats:
    """Positions (height, width, samples^2, 2) of a regular sample grid in each pixel.

    Args:
        camera: size of the image.
        samples_per_side: samples along a pixel's side.
        rows: consecutive rows of the image; None for all.
    """
    rows = range(camera.height_px) if rows is None else rows
    offsets = (np.arange(samples_per_side) + 0.5) / samples_per_side
    u = np.arange(camera.width_px)[:, None] + offsets
    v = np.arange(rows.start, rows.stop)[:, None] + offsets
    grid_v, grid_u = np.broadcast_arrays(v[:, None, :, None], u[None, :, None, :])
    grid = np.stack((grid_u, grid_v), axis=-1)
    return grid.reshape(len(rows), camera.width_px, samples_per_side * samples_per_side, 2)


def opencv_from_pixel(pixel: Floats) -> Floats:
    """Pixels in OpenCV's convention, in which pixel centres are integers."""
    return pixel - 0.5


# Of a plane of order 1; products with offsets of pixels stay finite.
_MAX_NUMBER = 1e100
# Newton doubles the digits of a start that is a thousandth off; 12 steps serve starts near a fold.
_MAX_STEPS = 12
# Of a plane of order 1; 1e-13 of a focal length of 1000 px is 1e-10 px.
_TOLERANCE = 1e-13
# Starts to a millionth, from which two or three steps lead to the last digits.
_NUM_STARTS = 1025
# At the fold itself Newton's method has no slope.
_INSIDE_FOLD = 1.0 - 1e-3
_INSIDE_LIMIT = 1.0 - 1e-9
# A fold is found between angles 0.3 degrees apart, then to the last digits; the determinant varies
# with the azimuth as a cosine, so 720 azimuths find its minimum to 1e-5 of its variation.
_NUM_AZIMUTHS, _NUM_ANGLES, _FINE_AZIMUTHS, _BISECTIONS = 72, 513, 720, 40


@runtime_checkable
class DistortedProjection(RadialProjection, Protocol):
    """Projection with radial distortion of a plane, on which a decentred lens acts as well."""

    def undistorted_ratio_from_t(self, t: Floats) -> Floats:
        """Radius before the distortion, in the projection's unit."""

    def t_from_undistorted_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius before the distortion."""

    def distortion_factor(self, squared_ratio: Floats) -> tuple[Floats, Floats]:
        """Distorted over undistorted radius at a squared undistorted radius, and its derivative
        by that square."""


@dataclass(frozen=True, slots=True)
class ImagePlane:
    """Stretch and decentring of an image plane; the defaults change nothing."""

    stretch: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 1.0)
    """Row-major 2 x 2 matrix from the plane (x right, y down) to pixels over the scale."""
    p1: float = 0.0
    """Tangential distortion: x += 2 p1 x y, y += p1 (r^2 + 2 y^2)."""
    p2: float = 0.0
    """Tangential distortion: x += p2 (r^2 + 2 x^2), y += 2 p2 x y."""

    def __post_init__(self) -> None:
        a, b, c, d = self.stretch
        is_small = all(abs(each) <= _MAX_NUMBER for each in (*self.stretch, self.p1, self.p2))
        if not is_small or a * d - b * c <= 0.0:
            raise DomainError(
                "an image plane needs finite numbers and a stretch of positive determinant, not "
                f"{self.stretch!r}, p1 = {self.p1!r}, p2 = {self.p2!r}"
            )

    @property
    def is_radial(self) -> bool:
        """Whether circles about the image's centre show one angle from the axis."""
        return self.stretch == (1.0, 0.0, 0.0, 1.0) and not self.is_decentred

    @property
    def is_decentred(self) -> bool:
        """Whether the plane has tangential distortion."""
        return self.p1 != 0.0 or self.p2 != 0.0

    @property
    def stretch_limits(self) -> tuple[float, float]:
        """Smallest and largest factor by which the stretch changes a length."""
        a, b, c, d = self.stretch
        # The matrix is a similarity plus a reflected one, whose factors add and subtract.
        similar, reflected = 0.5 * hypot(a + d, c - b), 0.5 * hypot(a - d, b + c)
        return similar - reflected, similar + reflected

    @property
    def max_displacement_factor(self) -> float:
        """Bound of the factor by which stretch and decentring enlarge an image radius: generous,
        for a rectangle around the image."""
        return self.stretch_limits[1] * (1.0 + 6.0 * (abs(self.p1) + abs(self.p2)))

    def mirror(self) -> ImagePlane:
        """The plane seen from behind: left and right exchanged."""
        a, b, c, d = self.stretch
        # 0.0 - b: no negative zero.
        return ImagePlane((a, 0.0 - b, 0.0 - c, d), self.p1, 0.0 - self.p2)

    def decentre(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Displacement of undistorted points of the plane by the tangential distortion."""
        xy, xx, yy = x * y, x * x, y * y
        return (
            2.0 * self.p1 * xy + self.p2 * (3.0 * xx + yy),
            self.p1 * (xx + 3.0 * yy) + 2.0 * self.p2 * xy,
        )

    def apply_stretch(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Offsets from the centre over the camera's scale, of points of the plane."""
        a, b, c, d = self.stretch
        return a * x + b * y, c * x + d * y

    def undo_stretch(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Points of the plane, of offsets from the centre over the camera's scale."""
        a, b, c, d = self.stretch
        determinant = a * d - b * c
        return (d * x - b * y) / determinant, (a * y - c * x) / determinant


NO_CHANGE = ImagePlane()
"""Plane of a camera with square pixels and a centred lens."""


def undo_distortion(
    projection: DistortedProjection, plane: ImagePlane, x: Floats, y: Floats
) -> tuple[Floats, Floats, Bools]:
    """Undistorted points of distorted ones under radial and tangential distortion, and validity.

    Newton's method in two dimensions from the point without tangential distortion. Invalid where it
    does not converge: beyond the fold.

    Args:
        projection: Radial distortion.
        plane: Tangential distortion.
        x: (...) distorted points.
        y: (...) distorted points.
    """
    shape = np.shape(x)
    x, y = np.ravel(x), np.ravel(y)
    radius = hypot(x, y)
    # Tangential distortion may lead a little beyond the table's largest radius, to its end.
    start = interpolate_linear(radius, *_tabulate_starts(projection))
    factor = np.where(radius > 0.0, start / np.where(radius > 0.0, radius, 1.0), 1.0)
    px, py = x * factor, y * factor
    found_x, found_y, converged = px.copy(), py.copy(), np.zeros(x.shape, dtype=np.bool_)
    place = np.arange(x.size)
    for _ in range(_MAX_STEPS):
        squared = px * px + py * py
        gain, _ = projection.distortion_factor(squared)
        dx, dy = plane.decentre(px, py)
        ex, ey = gain * px + dx - x, gain * py + dy - y
        error = hypot(ex, ey)
        found_x[place], found_y[place] = px, py
        converged[place] = error <= 10.0 * _TOLERANCE
        left = error > _TOLERANCE
        if not left.any():
            break
        # Points beyond the fold never converge: they must not repeat the steps of all others.
        place, x, y, px, py = place[left], x[left], y[left], px[left], py[left]
        ex, ey = ex[left], ey[left]
        j11, j12, j22 = distortion_jacobian(projection, plane, px, py)
        determinant = j11 * j22 - j12 * j12
        determinant = np.where(np.abs(determinant) > 1e-12, determinant, 1.0)
        px, py = px - (j22 * ex - j12 * ey) / determinant, py - (j11 * ey - j12 * ex) / determinant
    # The polynomial may grow again beyond its fold, where it has further solutions.
    fold = float(projection.undistorted_ratio_from_t(np.array(projection.t_limit)))
    inside = converged & (hypot(found_x, found_y) <= fold)
    return found_x.reshape(shape), found_y.reshape(shape), inside.reshape(shape)


@lru_cache(maxsize=64)
def _tabulate_starts(projection: DistortedProjection) -> tuple[Floats, Floats]:
    """Image radii without tangential distortion, and the radii before the distortion."""
    last_rad = 2.0 * arctan(_INSIDE_FOLD * projection.t_limit)
    t = tan(0.5 * np.linspace(0.0, last_rad, _NUM_STARTS))
    return projection.radius_ratio_from_t(t), projection.undistorted_ratio_from_t(t)


@lru_cache(maxsize=64)
def decentred_fold_rad(projection: DistortedProjection, plane: ImagePlane) -> float:
    """Smallest angle, over all azimuths, at which a decentred image turns back; inf if none does.

    There the determinant of the distortion's Jacobian vanishes: tangential distortion moves the
    fold by azimuth, by degrees for a published fish-eye.
    """
    last_rad = 2.0 * arctan(projection.t_limit) * _INSIDE_LIMIT
    azimuth = np.linspace(-math.pi, math.pi, _NUM_AZIMUTHS, endpoint=False)[:, None]
    theta = np.linspace(0.0, last_rad, _NUM_ANGLES)
    turns_back = _jacobian_determinant(projection, plane, theta, azimuth) <= 0.0
    if not turns_back.any():
        return math.inf
    first = int(turns_back.any(axis=0).argmax())
    # Of the azimuths, the one whose determinant falls lowest there; between, it varies as cos.
    fine = np.linspace(-math.pi, math.pi, _FINE_AZIMUTHS, endpoint=False)[:, None]
    low, high = float(theta[max(first - 1, 0)]), float(theta[first])
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        determinant = _jacobian_determinant(projection, plane, np.array([middle]), fine)
        low, high = (middle, high) if (determinant > 0.0).all() else (low, middle)
    return low


def _jacobian_determinant(
    projection: DistortedProjection, plane: ImagePlane, theta: Floats, azimuth: Floats
) -> Floats:
    """Determinant of the distortion's Jacobian at directions."""
    radius = projection.undistorted_ratio_from_t(tan(0.5 * theta))
    x, y = radius * cos(azimuth), radius * sin(azimuth)
    j11, j12, j22 = distortion_jacobian(projection, plane, x, y)
    return j11 * j22 - j12 * j12


def distortion_jacobian(
    projection: DistortedProjection, plane: ImagePlane, x: Floats, y: Floats
) -> tuple[Floats, Floats, Floats]:
    """Entries xx, xy and yy of the distortion's Jacobian, which is symmetric."""
    gain, slope = projection.distortion_factor(x * x + y * y)
    return (
        gain + 2.0 * slope * x * x + 2.0 * plane.p1 * y + 6.0 * plane.p2 * x,
        2.0 * slope * x * y + 2.0 * plane.p1 * x + 2.0 * plane.p2 * y,
        gain + 2.0 * slope * y * y + 6.0 * plane.p1 * y + 2.0 * plane.p2 * x,
    )


def cosine_fourth(tangent: Floats) -> Floats:
    """cos^4 of angles by their tangents."""
    # 1 / (1 + tan^2)^2 needs no arctangent and has no cancellation on the axis.
    factor: Floats = 1.0 / np.square(1.0 + np.square(tangent))
    return factor


@np.errstate(divide="ignore")
def wide_angle_illumination(projection: RadialProjection, t: Floats) -> Floats:
    """Relative illumination of a wide-angle lens at t = tan(theta / 2), at most 1.

    Next to a fold, where a pixel sees an unbounded solid angle, a real lens vignettes otherwise: no
    gain above the axis's is assumed.
    """
    squared = np.square(t)
    radius, slope = projection.radius_ratio_from_t(t), projection.radius_ratio_slope(t)
    on_axis = float(projection.radius_ratio_slope(np.array(0.0)))
    sine = 2.0 * t / (1.0 + squared)
    # r / sin(theta) is 0 / 0 on the axis, where it is the slope.
    is_off_axis = t > 1e-9
    across = np.where(is_off_axis, radius / np.where(is_off_axis, sine, 1.0), on_axis)
    return np.minimum(on_axis * on_axis / (across * slope), 1.0)


# Scales are smooth in the radius: 128 steps find their largest value to 1e-4.
_NUM_RINGS = 129
# A milliradian from the antipode, which a 360-degree lens shows as a circle: across the radius the
# scale is infinite there.
_MAX_T = tan(0.5 * (math.pi - 1e-3))


@dataclass(frozen=True, slots=True, eq=False)
class ImageScale:
    """Scales on rings of the visible image, from the innermost to the outermost; (n,) arrays."""

    t: Floats
    """tan(theta / 2) of each ring."""
    radius_px: Floats
    """Image radius of each ring."""
    radial: Floats
    """Pixels per radian along the image radius."""
    tangential: Floats
    """Pixels per radian across the image radius."""
    area_weight: Floats
    """Fraction of the image area around each ring; sums to 1."""

    @property
    def max_px_per_rad(self) -> float:
        """Largest scale, in any direction."""
        return float(np.maximum(self.radial, self.tangential).max())

    @property
    def rms_px_per_rad(self) -> float:
        """Root mean square of the scale over the image and all directions."""
        mean = 0.5 * (np.square(self.radial) + np.square(self.tangential))
        return math.sqrt(float(matmul(mean, self.area_weight)))


def compute_image_scale(camera: RadialCamera) -> ImageScale:
    """Scales on the rings that the image of a camera shows."""
    min_radius_px, max_radius_px = visible_radii_px(camera)
    radius_px = np.linspace(min_radius_px, max_radius_px, _NUM_RINGS)
    if min_radius_px == 0.0 and camera.t_from_radius_px(np.array(0.0)) > 0.0:
        # A cone's apex shows a circle of directions, on which the scale across the radius is 0.
        radius_px[0] = 0.5 * radius_px[1]
    t = np.minimum(camera.t_from_radius_px(radius_px), _MAX_T)
    horizon_px = camera.horizon_radius_px
    if min_radius_px < horizon_px < max_radius_px:
        # The side faces' centres lie on the horizon: there the texels of the cube are largest.
        place = np.searchsorted(radius_px, horizon_px)
        radius_px, t = np.insert(radius_px, place, horizon_px), np.insert(t, place, 1.0)
    radial = camera.max_stretch * camera.radius_slope_px(t)
    on_axis = t < 1e-9  # r / sin(theta) is 0 / 0 there; both scales are equal
    sine = np.where(on_axis, 1.0, 2.0 * t / (1.0 + np.square(t)))
    tangential = np.where(on_axis, radial, camera.max_stretch * radius_px / sine)
    # Area of a ring is proportional to d(r^2); differences of r^2 need no ring boundaries.
    area = np.gradient(np.square(radius_px))
    return ImageScale(t, radius_px, radial, tangential, area / area.sum())


def visible_radii_px(camera: RadialCamera) -> tuple[float, float]:
    """Smallest and largest image radius that the image shows within its borders."""
    size = (camera.width_px, camera.height_px)
    sides = tuple(zip(camera.centre_px, size, strict=True))
    # Distance from the optical axis to the image rectangle: 0 inside, else to the nearest border.
    min_px = hypot(*(max(-centre, 0.0, centre - length) for centre, length in sides))
    max_px = hypot(*(max(abs(centre), abs(length - centre)) for centre, length in sides))
    return min(min_px, camera.rim_radius_px), min(max_px, camera.rim_radius_px)


def shows_whole_rim(camera: RadialCamera) -> bool:
    """Whether the rim circle lies within the image borders on all sides."""
    # Inscribed rims touch the borders up to rounding, which a slack of 1e-9 absorbs.
    radius = camera.rim_radius_px * (1.0 - 1e-9)
    (u, v), width, height = camera.centre_px, camera.width_px, camera.height_px
    return min(u, v, width - u, height - v) >= radius
