"""Scale and shading of an image by its radius: pixels per radian, and natural vignetting.

A small angle is mapped by dr/dtheta along the image radius and by r / sin(theta) across the radius.
A central mirror's scales grow from the centre to the rim and stay close to each other: the
projection is nearly conformal. A flat image's are f / cos^2(theta) and f / cos(theta).

Natural vignetting is the irradiance of the image of a scene of one radiance, relative to the axis.
A pinhole or thin lens loses cos^4 of the angle of its chief ray: a cosine for its aperture, seen
obliquely, three for the solid angle of a pixel. A wide-angle lens turns its entrance pupil towards
the ray, so that its aperture keeps its area, and only the solid angle of a pixel remains,
sin(theta) / (r dr/dtheta): 1 for an equisolid lens, whose pixels see equal solid angles. Source:
Reiss 1945; Slyusarev 1984.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera, RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass


def cosine_fourth(tangent: Floats) -> Floats:
    """cos^4 of angles by their tangents."""
    # 1 / (1 + tan^2)^2 needs no arctangent and has no cancellation on the axis.
    factor: Floats = (1.0 + np.square(tangent)) ** -2
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
    return np.minimum(on_axis**2 / (across * slope), 1.0)


# Scales are smooth in the radius: 128 steps find their largest value to 1e-4.
_NUM_RINGS = 129
# A milliradian from the antipode, which a 360-degree lens shows as a circle: across the radius the
# scale is infinite there.
_MAX_T = math.tan(0.5 * (math.pi - 1e-3))


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
        return math.sqrt(float(mean @ self.area_weight))


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
    min_px = math.hypot(*(max(-centre, 0.0, centre - length) for centre, length in sides))
    max_px = math.hypot(*(max(abs(centre), abs(length - centre)) for centre, length in sides))
    return min(min_px, camera.rim_radius_px), min(max_px, camera.rim_radius_px)


def shows_whole_rim(camera: RadialCamera) -> bool:
    """Whether the rim circle lies within the image borders on all sides."""
    # Inscribed rims touch the borders up to rounding, which a slack of 1e-9 absorbs.
    radius = camera.rim_radius_px * (1.0 - 1e-9)
    (u, v), width, height = camera.centre_px, camera.width_px, camera.height_px
    return min(u, v, width - u, height - v) >= radius
