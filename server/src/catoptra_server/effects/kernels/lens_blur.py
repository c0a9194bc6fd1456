"""Circle of confusion: the disc to which a camera's lens spreads a point, with a mirror or without.

Behind a mirror. Along one ray a mirror images like a thin mirror of some power. The power of a
central mirror is the same in both planes, tangential and sagittal: the mirror images one of its
foci, the viewpoint, onto the other, the pinhole, without error. With rho and q the distances of the
mirror's point from viewpoint and pinhole, light aimed at the viewpoint (an object at -rho) meets at
q: the power is 1/q - 1/rho, and an object at D before the mirror has its virtual image s' behind
the mirror,

    1/s' = 1/D + P,   P = 1/rho - 1/q   (hyperbolic: 2a / (rho q), q = rho + 2a; parabolic: 1/rho),

without astigmatism. The image's depth from the pinhole is Z = (q + s') cos(psi). A thin lens of
focal length f and aperture f/N, focused at Z_f, spreads a point to a disc of
(f / N) f_px |1/Z - 1/Z_f|. The image scale f_px is the lens's image distance over the pixel pitch;
f follows from both: 1/f = 1 / (f_px pitch) + 1/Z_f. Equivalent: (f^2 / N) / (pitch (Z_f - f))
|Z - Z_f| / Z.

An orthographic camera is a telecentric lens of magnification m = pitch times px per metre: a point
dz before or behind the focus is spread to (m^2 / N) |dz| / pitch; N is the f-number on the image
side. Such a lens has no pinhole to measure a focus distance from: its focus is always the best one.

The mirrors are strongly curved, so everything beyond half a metre has nearly one disc for each
image radius; the best focus minimizes the largest of these discs. Domain: convex central mirrors,
P > 0 (a plane has P = 0 and adds no blur; a concave mirror, which images in front of itself, would
change signs, but none is implemented); points outside the mirror. Beyond the rim, where the lens
sees no mirror, the rim's disc applies. Source: derived here.

Without a mirror the same formula holds by range. The focus is a plane: Z = D cos(theta) at the
range D, and sharp points at the image's border are farther away than on the axis. A wide-angle lens
has a sphere instead: Z = D. A focus distance of 0 is infinity: the focus whose largest disc of
infinity is smallest, as behind a mirror; everything at the hyperfocal distance, (f / N) f_px
metres, or beyond has then a disc of at most 1 px. Domain: discs up to _MAX_DIAMETER_PX. A wider
disc is drawn as one of that diameter, since tables of wider ones grow with the fourth power; bounds
count the disc itself. Source: the thin-lens equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TypeGuard

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.image_plane import visible_radii_px
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import NUM_RINGS, Real, SceneSummary

# Guards the division for objects that reach into the mirror; no visible point comes so near. The
# kernel's stage has the same constant.
_MIN_DENOMINATOR = 1e-6


@dataclass(frozen=True, slots=True)
class Aperture:
    """Lens and sensor geometry that determine the depth of field."""

    f_number: float
    """Focal length over diameter of the aperture."""
    pixel_pitch_m: float
    """Distance between the centres of adjacent pixels."""
    focus_distance_m: float
    """Depth of sharp points from the pinhole; 0: the focus whose largest disc of infinity is
    smallest, which without a mirror is infinity itself."""

    def focus_coordinate(self, camera: RadialCamera) -> float:
        """1/Z_f of the lens's focus; of an orthographic camera the focus's height along the
        axis."""
        if not _has_mirror(camera):
            return 1.0 / self.focus_distance_m if self.focus_distance_m > 0.0 else 0.0
        if self.focus_distance_m > 0.0 and not math.isinf(camera.mirror.pinhole_distance_m):
            return 1.0 / self.focus_distance_m
        # The disc is linear in this coordinate: the midpoint of its range has the smallest maximum.
        coordinates = _virtual_image_of_infinity(camera, sample_radii_px(camera)).focus_coordinate
        return 0.5 * float(coordinates.min() + coordinates.max())


@dataclass(frozen=True, slots=True, eq=False)
class CircleOfConfusion:
    """Signed disc diameter as a function of the range D from the effective viewpoint.

    d(D) = infinity_diameter_px + near_px / (power_per_m D + offset); arrays broadcast. A point
    behind the focus has a negative diameter.
    """

    infinity_diameter_px: Floats
    near_px: Floats
    power_per_m: Floats
    offset: Floats

    @property
    def parameters(self) -> Floats:
        """The four in their order, along a last axis."""
        fields = (self.infinity_diameter_px, self.near_px, self.power_per_m, self.offset)
        return np.stack(fields, axis=-1)

    def near_term_px(self, range_m: Floats) -> Floats:
        """Difference of the signed diameter from that at infinity, 0 or more, px."""
        denominator = np.maximum(self.power_per_m * range_m + self.offset, _MIN_DENOMINATOR)
        term: Floats = self.near_px / denominator
        return term

    def diameter_px(self, range_m: Floats) -> Floats:
        """Disc diameter of points at a range; inf is allowed."""
        diameter: Floats = np.abs(self.infinity_diameter_px + self.near_term_px(range_m))
        return diameter

    def max_diameter_change_px(self, min_distance_m: Floats) -> Floats:
        """Largest change of a disc between infinity and the nearest distance.

        The disc of a point behind the focus first shrinks, at most to a point, and then grows.
        """
        # The signed diameter passes every value between infinity and the nearest distance, so a
        # disc behind the focus may change more before the end than at the end.
        behind_focus = np.maximum(-self.infinity_diameter_px, 0.0)
        shrinkage = np.minimum(self.near_term_px(min_distance_m), behind_focus)
        growth = self.diameter_px(min_distance_m) - np.abs(self.infinity_diameter_px)
        change: Floats = np.maximum(shrinkage, growth)
        return change


def circle_of_confusion(
    aperture: Aperture, camera: RadialCamera, radius_px: Floats
) -> CircleOfConfusion:
    """Circle of confusion at image radii."""
    if not _has_mirror(camera):
        return _thin_lens_circle_of_confusion(aperture, camera, radius_px)
    image = _virtual_image_of_infinity(camera, np.minimum(radius_px, camera.rim_radius_px))
    focus = aperture.focus_coordinate(camera)
    gain = _px_per_focus_coordinate(aperture, camera, focus)
    # An object at D has its image nearer than infinity's by (cos(psi) / P) / (1 + P D);
    # 1/Z of both gives the same form with another offset, so one rational function serves both
    # kinds of camera.
    nearer = image.cos_psi / image.power_per_m
    shift, slope = image.focus_coordinate * nearer, np.square(image.focus_coordinate)
    if math.isinf(camera.mirror.pinhole_distance_m):
        shift, slope = np.zeros_like(nearer), np.ones_like(nearer)
    return CircleOfConfusion(
        infinity_diameter_px=gain * (image.focus_coordinate - focus),
        near_px=gain * slope * nearer,
        power_per_m=image.power_per_m,
        # D counts from the mirror's point and the range from the viewpoint: rho apart.
        offset=1.0 - image.power_per_m * image.rho_m - shift,
    )


@lru_cache(maxsize=4)
def circle_of_confusion_map(aperture: Aperture, camera: RadialCamera) -> CircleOfConfusion:
    """Circle of confusion at every pixel centre, (h, w) arrays."""

    maps = map_of_radius(camera, lambda r: circle_of_confusion(aperture, camera, r).parameters)
    maps.setflags(write=False)
    return CircleOfConfusion(*np.moveaxis(maps, -1, 0))


_MAX_DIAMETER_PX = 16.0
"""Widest disc that is drawn. At F/4 and 90 degrees over 640 px of 7.4 um: of a point 12 mm away."""


@lru_cache(maxsize=16)
def max_diameter_px(aperture: Aperture, camera: RadialCamera) -> float:
    """Largest disc of any point outside the mirror; without one the largest that is drawn."""
    if not _has_mirror(camera):
        return _MAX_DIAMETER_PX
    # The signed diameter falls with the range: its extremes are at the mirror and at infinity.
    radius = sample_radii_px(camera)
    circle = circle_of_confusion(aperture, camera, radius)
    rho_m = _virtual_image_of_infinity(camera, radius).rho_m
    at_infinity = np.abs(circle.infinity_diameter_px)
    return float(np.maximum(at_infinity, circle.diameter_px(rho_m)).max())


def virtual_image_depth_m(camera: OmniCamera, t: Floats, distance_m: Floats) -> Floats:
    """Depth along the axis, from the pinhole, of the virtual image of a point before the mirror.

    Args:
        camera: A camera with a pinhole.
        t: tan(theta / 2) of the point's direction.
        distance_m: Distance from the mirror's point; inf is allowed.
    """
    r, z = camera.mirror.surface_point(t)
    rho, depth = hypot(r, z), camera.mirror.pinhole_distance_m - z
    q = hypot(r, depth)
    behind: Floats = 1.0 / (1.0 / distance_m + (1.0 / rho - 1.0 / q))
    return depth + behind * depth / q


def describe_lens(aperture: Aperture, camera: RadialCamera) -> str:
    """Describe the lens, for the reason of a bound."""
    if not _has_mirror(camera):
        distance_m = aperture.focus_distance_m
        focus = f"at {distance_m:.3g} m" if distance_m > 0.0 else "at infinity"
        return f"F/{aperture.f_number:g}, focused {focus}"
    if math.isinf(camera.mirror.pinhole_distance_m):
        return f"F/{aperture.f_number:g}, telecentric"
    focus_mm = 1e3 / aperture.focus_coordinate(camera)
    return f"F/{aperture.f_number:g}, focused at {focus_mm:.0f} mm"


# Fields of a summary that `min_distance_at_radius` reads.
DISTANCE_FIELDS = frozenset({"min_distances_m", "attached_min_distances_m"})


def min_distance_at_radius(
    summary: SceneSummary, camera: RadialCamera, radius_px: Floats
) -> Floats:
    """Lower bound of the range, m, of anything visible at image radii."""
    ring = radius_px / camera.rim_radius_px * NUM_RINGS
    min_distance_m = np.array(summary.visible_min_distances_m)
    # A radius on the border of two rings belongs to both: the smaller distance counts.
    inner = np.clip(np.ceil(ring) - 1.0, 0, NUM_RINGS - 1).astype(np.intp)
    outer = np.clip(np.floor(ring), 0, NUM_RINGS - 1).astype(np.intp)
    at_radius: Floats = np.minimum(min_distance_m[inner], min_distance_m[outer])
    return at_radius


# Discs are smooth in the radius: this many radii find the largest to 1e-4.
_NUM_RADII = 257


def sample_radii_px(camera: RadialCamera) -> Floats:
    """Image radii at which bounds are evaluated."""
    return np.linspace(*visible_radii_px(camera), _NUM_RADII)


def map_of_radius(
    camera: RadialCamera, function: Callable[[Floats], npt.NDArray[Real]]
) -> npt.NDArray[Real]:
    """Values of a function of the image radius at every pixel centre, (h, w, ...).

    Computed once for all pixels at the same distances from the centre in columns and rows: of a
    centred image for a quarter.

    Args:
        camera: Camera of the image.
        function: (m, n, ...) values at (m, n) radii, px, each by its own radius alone.
    """
    u = np.abs(np.arange(camera.width_px) + 0.5 - camera.centre_px[0])
    v = np.abs(np.arange(camera.height_px) + 0.5 - camera.centre_px[1])
    distances_u, columns = np.unique(u, return_inverse=True)
    distances_v, rows = np.unique(v, return_inverse=True)
    quarter = function(hypot(distances_u, distances_v[:, None]))
    # Columns first: rows are then copied as a whole.
    return quarter.take(columns, axis=1).take(rows, axis=0)


@lru_cache(maxsize=4)
def interior_mask(camera: RadialCamera) -> Bools:
    """Pixels, (h, w), whose whole square shows something: sees the mirror, where there is one."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    interior: Bools = u[None, :] ** 2 + v[:, None] ** 2 < np.square(_interior_radius_px(camera))
    interior.setflags(write=False)
    return interior


def _interior_radius_px(camera: RadialCamera) -> float:
    """Largest image radius of the centre of a pixel whose whole square shows something."""
    u, v = camera.centre_px
    corner_px = hypot(max(u, camera.width_px - u), max(v, camera.height_px - v))
    # No rim in the image: all pixels, those in the corners included.
    if corner_px <= camera.rim_radius_px:
        return corner_px
    # Half a pixel's diagonal inside the rim.
    return camera.rim_radius_px - math.sqrt(0.5)


@dataclass(frozen=True, slots=True, eq=False)
class _VirtualImage:
    """The mirror's virtual image of infinity at (n,) image radii."""

    rho_m: Floats
    """Distance of the mirror's point from the viewpoint."""
    power_per_m: Floats
    """Power P of the mirror at this point."""
    cos_psi: Floats
    """Cosine of the angle between the ray to the lens and the optical axis."""
    focus_coordinate: Floats
    """1/Z of the virtual image; of an orthographic camera the image's height along the axis."""


def _has_mirror(camera: RadialCamera) -> TypeGuard[OmniCamera]:
    return isinstance(camera, OmniCamera) and camera.has_mirror


def _virtual_image_of_infinity(camera: OmniCamera, radius_px: Floats) -> _VirtualImage:
    """Virtual image of infinity at image radii up to the rim."""
    t = camera.t_from_radius_px(radius_px)
    r, z = camera.mirror.surface_point(t)
    rho = hypot(r, z)
    if math.isinf(camera.mirror.pinhole_distance_m):
        # The limit q -> inf: P = 1/rho, and the image of infinity lies rho behind the surface.
        return _VirtualImage(rho, 1.0 / rho, np.ones_like(rho), z - rho)
    depth = camera.mirror.pinhole_distance_m - z
    q = hypot(r, depth)
    focus_coordinate = 1.0 / virtual_image_depth_m(camera, t, np.array(math.inf))
    return _VirtualImage(rho, 1.0 / rho - 1.0 / q, depth / q, focus_coordinate)


def _px_per_focus_coordinate(
    aperture: Aperture, camera: OmniCamera, focus_coordinate: float
) -> float:
    """Disc diameter per difference of focus coordinates: px m, or px per m if orthographic."""
    if math.isinf(camera.mirror.pinhole_distance_m):
        # m^2 / (N pitch) with m = pitch px_per_m.
        rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
        px_per_m = camera.rim_radius_px / rim_m
        return px_per_m * px_per_m * aperture.pixel_pitch_m / aperture.f_number
    return _thin_lens_px_m(aperture, camera, focus_coordinate)


def _thin_lens_px_m(aperture: Aperture, camera: RadialCamera, inverse_focus_per_m: float) -> float:
    """Disc diameter per difference of inverse depths, px m, of a lens with a pinhole."""
    focal_px = 1.0 / camera.inverse_focal_length
    focal_m = 1.0 / (1.0 / (focal_px * aperture.pixel_pitch_m) + inverse_focus_per_m)
    return focal_m / aperture.f_number * focal_px


def _thin_lens_circle_of_confusion(
    aperture: Aperture, camera: RadialCamera, radius_px: Floats
) -> CircleOfConfusion:
    """Circle of confusion of a camera without a mirror."""
    focus = aperture.focus_coordinate(camera)
    px_m = _thin_lens_px_m(aperture, camera, focus)
    ones = np.ones_like(np.asarray(radius_px, dtype=np.float64))
    inverse_cosine = ones
    if isinstance(camera, PerspectiveCamera):
        # 1 / cos(theta) turns the inverse range into the inverse depth.
        inverse_cosine = hypot(1.0, radius_px * camera.inverse_focal_length)
    return CircleOfConfusion(
        infinity_diameter_px=ones * (-px_m * focus),
        near_px=px_m * inverse_cosine,
        power_per_m=ones,
        offset=0.0 * ones,
    )
