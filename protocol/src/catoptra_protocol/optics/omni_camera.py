"""Omnidirectional camera: from a direction at the effective viewpoint to a pixel, and back.

The image is that of a real capture camera, which looks up into the mirror, and therefore mirrored:
with forward up, a landmark on the robot's left appears on the right. Domain: incidence angles up to
the rim, pixels on the mirror's disc; each function returns a mask beside its value.
"""

from __future__ import annotations

import math
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors.central_mirror import CentralMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass

Element = TypeVar("Element", bound=np.generic)

_MIN_NORMAL = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True)
class OmniCamera:
    """Central mirror, and the position of the mirror's axis and 90-degree circle in the image."""

    mirror: CentralMirror
    """Projection of the mirror."""
    width_px: int
    """Number of columns."""
    height_px: int
    """Number of rows."""
    centre_px: tuple[float, float]
    """Pixel (u, v) of the optical axis; pixel centres are at +0.5."""
    horizon_radius_px: float
    """Radius of the 90-degree circle: h of Eq. 2."""
    rim_rad: float
    """Incidence angle at the rim of the mirror; pixels beyond the rim are invalid."""
    image_up_azimuth_rad: float = 0.0
    """Azimuth in the mirror frame (x towards y) that points up in the image."""

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise DomainError(f"an image of {self.width_px} x {self.height_px} px has no pixel")
        if not (math.isfinite(self.horizon_radius_px) and self.horizon_radius_px > 0.0):
            raise DomainError(
                f"the 90-degree circle needs a radius > 0: {self.horizon_radius_px!r}"
            )
        if not all(map(math.isfinite, (*self.centre_px, self.image_up_azimuth_rad))):
            raise DomainError(
                "the image centre and the azimuth that points up must be finite: "
                f"{self.centre_px!r}, {self.image_up_azimuth_rad!r}"
            )
        if not 0.0 < self.rim_rad < math.pi or self.rim_t >= self.mirror.t_limit:
            limit = math.degrees(2.0 * math.atan(self.mirror.t_limit))
            raise DomainError(
                f"a rim at {math.degrees(self.rim_rad):g} deg lies beyond the reach of this "
                f"mirror: it must be above 0 and below {limit:.3f} deg"
            )

    @property
    def rim_t(self) -> float:
        """Half-angle tangent of the rim, tan(rim / 2)."""
        return math.tan(0.5 * self.rim_rad)

    @property
    def rim_radius_px(self) -> float:
        """Image radius of the rim."""
        return self.horizon_radius_px * float(self.mirror.radius_ratio_from_t(np.array(self.rim_t)))

    @property
    def optical_axis(self) -> tuple[float, float, float]:
        """The mirror's axis: +z of the mirror frame."""
        return 0.0, 0.0, 1.0

    @property
    def inverse_focal_length(self) -> float:
        """1 / f of the capture camera, 1/px: tan(psi) per image radius; 0 if orthographic."""
        # The inverse, since f itself is infinite for an orthographic camera.
        pinhole_m = self.mirror.pinhole_distance_m
        if math.isinf(pinhole_m):
            return 0.0
        # From the rim, whose position on the mirror and whose image radius are both known exactly.
        r, z = self.mirror.surface_point(np.array(self.rim_t))
        return float(r) / (pinhole_m - float(z)) / self.rim_radius_px

    def t_from_radius_px(self, radius_px: Floats) -> Floats:
        """tan(theta / 2) of image radii."""
        return self.mirror.t_from_radius_ratio(radius_px / self.horizon_radius_px)

    def radius_slope_px(self, t: Floats) -> Floats:
        """Pixels per radian along the image radius at t = tan(theta / 2)."""
        return self.horizon_radius_px * self.mirror.radius_ratio_slope(t)

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit directions of pixels in the mirror frame: see `direction_from_pixel` below."""
        return direction_from_pixel(self, pixel)


def camera_with_inscribed_rim(
    mirror: CentralMirror,
    *,
    width_px: int,
    height_px: int,
    rim_rad: float,
    image_up_azimuth_rad: float = 0.0,
) -> OmniCamera:
    """Camera with a centred rim circle that touches the nearer pair of image borders."""
    t = math.tan(0.5 * rim_rad)
    # An impossible rim gets ratio 1 here and is rejected by OmniCamera, with the limit in degrees.
    rim_ratio = float(mirror.radius_ratio_from_t(np.array(t))) if 0.0 < t < mirror.t_limit else 1.0
    return OmniCamera(
        mirror=mirror,
        width_px=width_px,
        height_px=height_px,
        centre_px=(0.5 * width_px, 0.5 * height_px),
        horizon_radius_px=0.5 * min(width_px, height_px) / rim_ratio,
        rim_rad=rim_rad,
        image_up_azimuth_rad=image_up_azimuth_rad,
    )


@np.errstate(under="ignore")  # terms far below the largest component may vanish
def half_angle_tangent(direction: Floats) -> tuple[Floats, Bools]:
    """t = tan(theta / 2) of (..., 3) directions in the mirror frame, and where t is finite.

    Invalid, with the value 0: the zero vector, the antipode, directions that are not finite, and
    directions nearer to the antipode than 1e-308 rad.
    """
    x, y, z = _scale_components(direction)
    return _half_angle_tangent_from_rho_z(np.hypot(x, y), z)


def _half_angle_tangent_from_rho_z(rho: Floats, z: Floats) -> tuple[Floats, Bools]:
    """t of directions at distance rho from the axis and height z, and a validity mask."""
    norm = np.hypot(rho, z)
    # tan(theta / 2) = rho / (norm + z) = (norm - z) / rho: one form for each hemisphere, chosen so
    # that the sum or difference adds terms of one sign.
    lower = z >= 0.0
    numerator = np.where(lower, rho, norm - z)
    denominator = np.where(lower, norm + z, rho)
    # The numerator is at most 2: over a normal number the quotient is finite.
    valid = denominator >= _MIN_NORMAL
    return np.where(valid, numerator, 0.0) / np.where(valid, denominator, 1.0), valid


def _scale_components(direction: Floats) -> tuple[Floats, Floats, Floats]:
    """x, y, z of (..., 3) directions, divided by the largest component so that squares stay finite.

    Zero where a direction is not finite.
    """
    direction = np.asarray(direction, dtype=np.float64)
    finite = np.isfinite(direction).all(axis=-1, keepdims=True)
    direction = np.where(finite, direction, 0.0)
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    x, y, z = np.moveaxis(direction / np.where(largest > 0.0, largest, 1.0), -1, 0)
    return x, y, z


@np.errstate(under="ignore")
def pixel_from_direction(camera: OmniCamera, direction: Floats) -> tuple[Floats, Bools]:
    """Pixel of a direction in the mirror frame, and whether the mirror reflects the direction.

    Source: Schmits & Visser 2009, Eq. 2, with the exact image radius of the mirror.

    Args:
        camera: the camera model.
        direction: (..., 3) in the mirror frame, of any length.

    Returns:
        (..., 2) pixels and a (...) mask. A direction on the axis has exactly the image centre;
            invalid pixels are the image centre as well, never NaN.
    """
    x, y, z = _scale_components(direction)
    rho = np.hypot(x, y)
    t, defined = _half_angle_tangent_from_rho_z(rho, z)
    valid = defined & (t <= camera.rim_t)
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(
        np.where(valid, t, 0.0)
    )
    # x / rho first, at most 1: radius_px / rho overflows for directions close to the axis.
    rho = np.where(rho > 0.0, rho, 1.0)
    x = radius_px * (x / rho)
    y = radius_px * (y / rho)
    ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    # Both terms of v are negative: the rotation by the up azimuth includes the reflection that
    # makes the image mirrored.
    u = camera.centre_px[0] + sa * x - ca * y
    v = camera.centre_px[1] - ca * x - sa * y
    return np.stack((u, v), axis=-1), valid


@np.errstate(under="ignore")
def direction_from_pixel(camera: OmniCamera, pixel: Floats) -> tuple[Floats, Bools]:
    """Unit direction in the mirror frame of a pixel, and whether the pixel lies on the mirror.

    Args:
        camera: the camera model.
        pixel: (..., 2), u right and v down.

    Returns:
        (..., 3) directions and a (...) mask; invalid pixels have the direction +z, never NaN.
    """
    pixel = np.asarray(pixel, dtype=np.float64)
    du, near_u = _offset_from_centre(camera, pixel[..., 0], camera.centre_px[0])
    dv, near_v = _offset_from_centre(camera, pixel[..., 1], camera.centre_px[1])
    near = near_u & near_v
    # Pixels far outside get the direction of the axis.
    ratio = np.where(near, np.hypot(du, dv), 0.0)
    sine, cosine, on_mirror = _incidence_from_radius_ratio(camera, ratio)
    direction = np.zeros((*ratio.shape, 3))
    _write_directions(camera, (du, dv), ratio, sine, cosine, out=direction)
    return direction, near & on_mirror


@np.errstate(under="ignore")
def direction_from_pixel_grid(camera: OmniCamera, u: Floats, v: Floats) -> tuple[Floats, Bools]:
    """Unit directions of all pixels of a grid, as of `direction_from_pixel` to the last bit.

    The incidence angle is computed once for all columns and rows at the same distances from the
    centre: in an image with a centred mirror for a quarter of the grid.

    Args:
        camera: the camera model.
        u: (w,) columns.
        v: (h,) rows.

    Returns:
        (h, w, 3) directions, stored component by component, and a (h, w) mask; invalid pixels have
            the direction +z, never NaN.
    """
    du, near_u = _offset_from_centre(camera, u, camera.centre_px[0])
    dv, near_v = _offset_from_centre(camera, v, camera.centre_px[1])
    distances_u, columns = np.unique(np.abs(du), return_inverse=True)
    distances_v, rows = np.unique(np.abs(dv), return_inverse=True)
    ratio = np.hypot(distances_u, distances_v[:, None])
    sine, cosine, on_mirror = _incidence_from_radius_ratio(camera, ratio)

    def spread(quarter: npt.NDArray[Element]) -> npt.NDArray[Element]:
        # Columns first: rows are then copied as a whole.
        return quarter[:, columns][rows]

    ratio, sine, cosine = spread(ratio), spread(sine), spread(cosine)
    # A component is written as a whole, three times as fast as every third number.
    direction = np.moveaxis(np.zeros((3, *ratio.shape)), 0, -1)
    _write_directions(camera, (du, dv[:, None]), ratio, sine, cosine, out=direction)
    direction[:, ~near_u] = direction[~near_v] = (0.0, 0.0, 1.0)
    return direction, spread(on_mirror) & near_u & near_v[:, None]


def _incidence_from_radius_ratio(camera: OmniCamera, ratio: Floats) -> tuple[Floats, Floats, Bools]:
    """Sine and cosine of the incidence angle at image radii, and whether these are on the mirror.

    The axis beside the mirror.
    """
    t = camera.mirror.t_from_radius_ratio(ratio)
    on_mirror = t <= camera.rim_t
    t = np.where(on_mirror, t, 0.0)
    one_plus = 1.0 + np.square(t)
    return 2.0 * t / one_plus, (1.0 - t) * (1.0 + t) / one_plus, on_mirror


def _write_directions(
    camera: OmniCamera,
    offset: tuple[Floats, Floats],
    ratio: Floats,
    sine: Floats,
    cosine: Floats,
    *,
    out: Floats,
) -> None:
    """Write the (..., 3) directions of offsets (du, dv) from the centre, `ratio` their length."""
    du, dv = offset
    # On the axis du = dv = 0, so any finite divisor gives the direction +z.
    ratio = np.where(ratio > 0.0, ratio, 1.0)
    ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    out[..., 0] = sine * ((sa * du - ca * dv) / ratio)
    out[..., 1] = sine * ((-ca * du - sa * dv) / ratio)
    out[..., 2] = cosine


def _offset_from_centre(
    camera: OmniCamera, positions: Floats, centre: float
) -> tuple[Floats, Bools]:
    """Offsets along an axis from the centre, in radii of the 90-degree circle, and whether they are
    within twice the rim's radius; 0 where not.
    """
    # Masked before anything else, because hypot may overflow far outside; NaN compares false.
    # Halved operands: the difference of two large floats overflows, that of their halves does not.
    near = np.asarray(np.abs(0.5 * positions - 0.5 * centre) <= camera.rim_radius_px)
    return (np.where(near, positions, centre) - centre) / camera.horizon_radius_px, near


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
