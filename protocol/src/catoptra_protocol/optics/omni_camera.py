"""Omnidirectional camera: from a direction at the effective viewpoint to a pixel, and back.

A projection gives the image radius of an angle from the optical axis, the image plane stretches and
displaces it, scale and centre make pixels. A mirror's image is that of a real capture camera, which
looks up into the mirror, and therefore mirrored: with forward up, a landmark on the robot's left
appears on the right. A lens's image is not; `picture` says which. Domain: angles up to the rim,
pixels on the disc within it; each function returns a mask beside its value.

A radial projection and an image plane, because all calibrations of the field are: an image radius
by the angle from the axis (a mirror or a lens), then tangential distortion, a matrix and a centre.
Plans, bounds, effects, client and page take the projection by its functions of t alone, so a new
one needs no line there. A stretched plane counts by the factor that bounds it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import arctan, cos, hypot, sin, tan
from catoptra_protocol.optics.image_plane import (
    NO_CHANGE,
    DistortedProjection,
    ImagePlane,
    cosine_fourth,
    decentred_fold_rad,
    undo_distortion,
    wide_angle_illumination,
)
from catoptra_protocol.optics.mirrors.mirror import Mirror
from catoptra_protocol.optics.numerics import (
    Bools,
    Floats,
    half_angle_tangent_from_rho_z,
    scale_components,
)
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection, describe_limit
from catoptra_protocol.slotted_dataclass import dataclass

_Element = TypeVar("_Element", bound=np.generic)


@dataclass(frozen=True, slots=True)
class OmniCamera:
    """Projection of a mirror or a lens, and the position of its axis and scale in the image."""

    projection: RadialProjection
    """Image radius of an angle from the axis: a mirror or a lens."""
    width_px: int
    """Number of columns."""
    height_px: int
    """Number of rows."""
    centre_px: tuple[float, float]
    """Pixel (u, v) of the optical axis; pixel centres are at +0.5."""
    scale_px: float
    """Pixels per unit of the projection's image radius: h of Eq. 2 for mirrors, the focal length
    for lenses."""
    rim_rad: float
    """Largest angle from the axis that is shown, the incidence at a mirror's rim; pixels beyond
    are invalid."""
    image_up_azimuth_rad: float = 0.0
    """Azimuth in the mirror frame (x towards y) that points up in the image."""
    picture: Picture = Picture.MIRRORED
    """Hand of the image."""
    plane: ImagePlane = NO_CHANGE
    """Stretch and decentring of the image plane."""
    is_approximated: bool = False
    """Whether rays of a mirror without a viewpoint are taken to meet in the effective one."""
    model_error_px: float = 0.0
    """How far the model may be from the lens that was calibrated; 0 if nothing is stated."""

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise DomainError(f"an image of {self.width_px} x {self.height_px} px has no pixel")
        if not (math.isfinite(self.scale_px) and self.scale_px > 0.0):
            raise DomainError(
                "the unit of the image (a mirror's 90-degree circle, a lens's focal length) needs "
                f"a radius > 0: {self.scale_px!r} px"
            )
        if not all(map(math.isfinite, (*self.centre_px, self.image_up_azimuth_rad))):
            raise DomainError(
                "the image centre and the azimuth that points up must be finite: "
                f"{self.centre_px!r}, {self.image_up_azimuth_rad!r}"
            )
        if self.plane.is_decentred and not isinstance(self.projection, DistortedProjection):
            raise DomainError(
                f"p1 and p2 belong to a projection with radial distortion, not to {self.projection}"
            )
        _require_rim(self.projection, self.rim_rad)
        if self.rim_rad > self.fold_rad:
            raise DomainError(
                f"a rim at {math.degrees(self.rim_rad):g} deg lies beyond the first fold of this "
                f"lens: with p1 and p2 its image turns back at {math.degrees(self.fold_rad):.3f} "
                f"deg, although without it ends at {describe_limit(self.projection)}"
            )

    @property
    def fold_rad(self) -> float:
        """Smallest angle, over all azimuths, at which the image turns back; inf if none does."""
        if not self.plane.is_decentred:
            return self.projection.fold_rad
        return decentred_fold_rad(cast(DistortedProjection, self.projection), self.plane)

    @property
    def mirror(self) -> Mirror:
        """The mirror.

        Raises:
            DomainError: The camera has none.
        """
        if not self.has_mirror:
            raise DomainError(f"a camera without a mirror has no mirror surface: {self.projection}")
        return cast(Mirror, self.projection)

    @property
    def has_mirror(self) -> bool:
        """Whether the projection is a mirror's."""
        return hasattr(self.projection, "surface_point")

    @property
    def is_central(self) -> bool:
        """Whether all rays meet in the effective viewpoint, or are taken to."""
        return self.is_approximated or not self.has_mirror or self.mirror.is_central

    @property
    def rim_t(self) -> float:
        """Half-angle tangent of the rim, tan(rim / 2)."""
        return tan(0.5 * self.rim_rad)

    @property
    def rim_radius_px(self) -> float:
        """Image radius of the rim."""
        return self.scale_px * float(self.projection.radius_ratio_from_t(np.array(self.rim_t)))

    @property
    def horizon_radius_px(self) -> float:
        """Image radius of 90 degrees, h of Eq. 2; inf where no image radius has this angle."""
        if not self.projection.t_min <= 1.0 < self.projection.t_limit:
            return math.inf
        return self.scale_px * float(self.projection.radius_ratio_from_t(np.array(1.0)))

    @property
    def max_stretch(self) -> float:
        """Bound of the factor by which the image plane enlarges a length."""
        return self.plane.max_displacement_factor

    @property
    def optical_axis(self) -> tuple[float, float, float]:
        """+z of the mirror frame."""
        return 0.0, 0.0, 1.0

    @property
    def inverse_focal_length(self) -> float:
        """1 / f of the capture camera, 1/px: tan(psi) per image radius; 0 if telecentric.

        Of a camera without a mirror that of the image's centre.
        """
        if not self.has_mirror:
            return 1.0 / float(self.radius_slope_px(np.array(0.0)))
        # The inverse, since f itself is infinite for a telecentric camera.
        pinhole_m = self.mirror.pinhole_distance_m
        if math.isinf(pinhole_m):
            return 0.0
        # From the rim, whose position on the mirror and whose image radius are both known exactly.
        r, z = self.mirror.surface_point(np.array(self.rim_t))
        return float(r) / (pinhole_m - float(z)) / self.rim_radius_px

    def relative_illumination(self, radius_px: Floats) -> Floats:
        """Irradiance at image radii over that on the axis, of a scene of one radiance.

        A mirror preserves radiance: only the capture camera's lens shades the image.
        """
        if self.has_mirror:
            return cosine_fourth(np.asarray(radius_px) * self.inverse_focal_length)
        t = np.minimum(self.t_from_radius_px(np.asarray(radius_px)), self.rim_t)
        return wide_angle_illumination(self.projection, t)

    def t_from_radius_px(self, radius_px: Floats) -> Floats:
        """tan(theta / 2) of image radii; never above the rim's for radii up to the rim's."""
        t = self.projection.t_from_radius_ratio(radius_px / self.scale_px)
        # Next to a fold the inverse has half the digits.
        return np.where(radius_px <= self.rim_radius_px, np.minimum(t, self.rim_t), t)

    def radius_px_from_t(self, t: Floats) -> Floats:
        """Image radii of t = tan(theta / 2), before the stretch of the image plane."""
        return self.scale_px * self.projection.radius_ratio_from_t(t)

    def radius_slope_px(self, t: Floats) -> Floats:
        """Pixels per radian along the image radius at t = tan(theta / 2)."""
        return self.scale_px * self.projection.radius_ratio_slope(t)

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit directions of pixels in the mirror frame: see `direction_from_pixel` below."""
        return direction_from_pixel(self, pixel)

    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Pixels of directions in the mirror frame: see `pixel_from_direction` below."""
        return pixel_from_direction(self, direction)

    def with_picture(self, picture: Picture) -> OmniCamera:
        """The camera of the same picture, turned round left to right where the hands differ."""
        if picture is self.picture:
            return self
        u, v = self.centre_px
        return replace(self, centre_px=(self.width_px - u, v), picture=picture)


def _require_rim(projection: RadialProjection, rim_rad: float) -> None:
    """Raise DomainError for a rim that the projection does not reach."""
    # A mirror does not reflect its antipode, even where the formula's limit is there.
    reaches_antipode = math.isinf(projection.t_limit) and not hasattr(projection, "surface_point")
    in_half_turn = 0.0 < rim_rad < math.pi or (rim_rad == math.pi and reaches_antipode)
    lowest = math.degrees(2.0 * arctan(projection.t_min))
    if not in_half_turn or not projection.t_min < tan(0.5 * rim_rad) < projection.t_limit:
        raise DomainError(
            f"a rim at {math.degrees(rim_rad):g} deg lies beyond the reach of this "
            f"{'mirror' if hasattr(projection, 'surface_point') else 'lens'}: it must be above "
            f"{lowest:g} and below {describe_limit(projection)}"
        )


def camera_with_inscribed_rim(
    projection: RadialProjection,
    *,
    width_px: int,
    height_px: int,
    rim_rad: float,
    image_up_azimuth_rad: float = 0.0,
    picture: Picture = Picture.MIRRORED,
) -> OmniCamera:
    """Camera with a centred rim circle that touches the nearer pair of image borders.

    Raises:
        DomainError: A rim that the projection does not reach.
    """
    _require_rim(projection, rim_rad)
    rim_ratio = float(projection.radius_ratio_from_t(np.array(tan(0.5 * rim_rad))))
    return OmniCamera(
        projection=projection,
        width_px=width_px,
        height_px=height_px,
        centre_px=(0.5 * width_px, 0.5 * height_px),
        scale_px=0.5 * min(width_px, height_px) / rim_ratio,
        rim_rad=rim_rad,
        image_up_azimuth_rad=image_up_azimuth_rad,
        picture=picture,
    )


@np.errstate(under="ignore")
def pixel_from_direction(camera: OmniCamera, direction: Floats) -> tuple[Floats, Bools]:
    """Pixel of a direction in the mirror frame, and whether the camera shows the direction.

    Source: Schmits & Visser 2009, Eq. 2, with the exact image radius of the projection.

    Args:
        camera: the camera model.
        direction: (..., 3) in the mirror frame, of any length.

    Returns:
        (..., 2) pixels and a (...) mask. A direction on the axis has exactly the image centre;
            invalid pixels are the image centre as well, never NaN.
    """
    x, y, z = scale_components(direction)
    rho = hypot(x, y)
    t, defined = half_angle_tangent_from_rho_z(rho, z)
    valid = defined & (t <= camera.rim_t) & (t >= camera.projection.t_min)
    t = np.where(valid, t, camera.projection.t_min)
    radius = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    # x / rho first, at most 1: radius / rho overflows for directions close to the axis.
    rho = np.where(rho > 0.0, rho, 1.0)
    x, y = x / rho, y / rho
    ca, sa = cos(camera.image_up_azimuth_rad), sin(camera.image_up_azimuth_rad)
    # Unit vectors to the right and down in the right-handed picture.
    right, down = ca * y - sa * x, -ca * x - sa * y
    du, dv = radius * right, radius * down
    plane = camera.plane
    if not plane.is_radial:
        if plane.is_decentred:
            projection = cast(DistortedProjection, camera.projection)
            undistorted = projection.undistorted_ratio_from_t(t)
            off_u, off_v = plane.decentre(undistorted * right, undistorted * down)
            du, dv = du + camera.scale_px * off_u, dv + camera.scale_px * off_v
        du, dv = plane.apply_stretch(du, dv)
    if camera.picture is Picture.MIRRORED:
        du = -du
    return np.stack((camera.centre_px[0] + du, camera.centre_px[1] + dv), axis=-1), valid


@np.errstate(under="ignore")
def direction_from_pixel(camera: OmniCamera, pixel: Floats) -> tuple[Floats, Bools]:
    """Unit direction in the mirror frame of a pixel, and whether the pixel lies within the rim.

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
    du, dv, t, defined = _plane_point(camera, np.where(near, du, 0.0), np.where(near, dv, 0.0))
    ratio = hypot(du, dv)
    sine, cosine, on_mirror = _sine_cosine(camera, t)
    direction = np.zeros((*ratio.shape, 3))
    _write_directions(camera, (du, dv), ratio, sine, cosine, out=direction)
    valid = near & on_mirror & defined
    if camera.projection.t_min > 0.0:
        # A cone's apex shows a circle of directions: none.
        valid &= ratio > 0.0
        direction[~valid] = (0.0, 0.0, 1.0)
    return direction, valid


@np.errstate(under="ignore")
def direction_from_pixel_grid(camera: OmniCamera, u: Floats, v: Floats) -> tuple[Floats, Bools]:
    """Unit directions of all pixels of a grid, as of `direction_from_pixel` to the last bit.

    The angle from the axis is computed once for all columns and rows at the same distances from the
    centre: in an image with a centred rim for a quarter of the grid.

    Args:
        camera: the camera model.
        u: (w,) columns.
        v: (h,) rows.

    Returns:
        (h, w, 3) directions, stored component by component, and a (h, w) mask; invalid pixels have
            the direction +z, never NaN.
    """
    if not camera.plane.is_radial or camera.projection.t_min > 0.0:
        return direction_from_pixel(camera, np.stack(np.meshgrid(u, v), axis=-1))
    du, near_u = _offset_from_centre(camera, u, camera.centre_px[0])
    dv, near_v = _offset_from_centre(camera, v, camera.centre_px[1])
    distances_u, columns = np.unique(np.abs(du), return_inverse=True)
    distances_v, rows = np.unique(np.abs(dv), return_inverse=True)
    ratio = hypot(distances_u, distances_v[:, None])
    sine, cosine, on_mirror = _sine_cosine(camera, camera.projection.t_from_radius_ratio(ratio))

    def spread(quarter: npt.NDArray[_Element]) -> npt.NDArray[_Element]:
        # Columns first: rows are then copied as a whole.
        return quarter[:, columns][rows]

    ratio, sine, cosine = spread(ratio), spread(sine), spread(cosine)
    # A component is written as a whole, three times as fast as every third number.
    direction = np.moveaxis(np.zeros((3, *ratio.shape)), 0, -1)
    _write_directions(camera, (du, dv[:, None]), ratio, sine, cosine, out=direction)
    direction[:, ~near_u] = direction[~near_v] = (0.0, 0.0, 1.0)
    return direction, spread(on_mirror) & near_u & near_v[:, None]


def _plane_point(
    camera: OmniCamera, du: Floats, dv: Floats
) -> tuple[Floats, Floats, Floats, Bools]:
    """Points of the plane towards the scene point, t, and validity, of offsets over the scale."""
    plane = camera.plane
    if plane.is_radial:
        t = camera.projection.t_from_radius_ratio(hypot(du, dv))
        return du, dv, t, np.ones(t.shape, dtype=np.bool_)
    # The plane's axes are those of the right-handed picture.
    sign = -1.0 if camera.picture is Picture.MIRRORED else 1.0
    # Of a single pixel these are NumPy's scalars.
    x, y = map(np.asarray, plane.undo_stretch(sign * du, dv))
    if not plane.is_decentred:
        t = camera.projection.t_from_radius_ratio(hypot(x, y))
        return sign * x, y, t, np.ones(t.shape, dtype=np.bool_)
    projection = cast(DistortedProjection, camera.projection)
    x, y, converged = undo_distortion(projection, plane, x, y)
    t = projection.t_from_undistorted_ratio(np.where(converged, hypot(x, y), 0.0))
    return sign * x, y, t, converged


def _sine_cosine(camera: OmniCamera, t: Floats) -> tuple[Floats, Floats, Bools]:
    """Sine and cosine of the angle from the axis, and whether it is within the rim.

    The axis beyond the rim.
    """
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
    if camera.picture is Picture.FLIPPED:
        du = -du
    # On the axis du = dv = 0, so any finite divisor gives the direction +z.
    ratio = np.where(ratio > 0.0, ratio, 1.0)
    ca, sa = cos(camera.image_up_azimuth_rad), sin(camera.image_up_azimuth_rad)
    out[..., 0] = sine * ((sa * du - ca * dv) / ratio)
    out[..., 1] = sine * ((-ca * du - sa * dv) / ratio)
    out[..., 2] = cosine


def _offset_from_centre(
    camera: OmniCamera, positions: Floats, centre: float
) -> tuple[Floats, Bools]:
    """Offsets along an axis from the centre, over the scale, and whether they are within twice the
    rim's radius; 0 where not.
    """
    # Masked before anything else, because hypot may overflow far outside; NaN compares false.
    # Halved operands: the difference of two large floats overflows, that of their halves does not.
    largest = camera.rim_radius_px * camera.plane.max_displacement_factor
    near = np.asarray(np.abs(0.5 * positions - 0.5 * centre) <= largest)
    return (np.where(near, positions, centre) - centre) / camera.scale_px, near
