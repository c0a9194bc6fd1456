"""How wide the capture camera's lens spreads a point that a curved mirror shows.

Along one ray a mirror images as a thin mirror of some power does. A central mirror's is the same in
both planes, tangential and sagittal: it images one of its foci, the viewpoint, onto the other, the
pinhole, without error. With rho and q the distances of the mirror's point from viewpoint and
pinhole, light aimed at the viewpoint (an object at -rho) meets at q: the power is 1/q - 1/rho, and
what is D before the mirror is seen s' behind it,

    1/s' = 1/D + P,   P = 1/rho - 1/q   (hyperbolic: 2a / (rho q), q = rho + 2a; parabolic: 1/rho),

with no astigmatism. Its depth from the pinhole is Z = (q + s') cos(psi). A thin lens of focal
length f and aperture f/N, focused at Z_f, spreads it to a disc of (f / N) f_px |1/Z - 1/Z_f|. The
picture's scale f_px is the lens's image distance over the pixel's pitch; f follows from both:
1/f = 1 / (f_px pitch) + 1/Z_f. So (f^2 / N) / (pitch (Z_f - f)) |Z - Z_f| / Z, in other words.

An orthographic camera is a telecentric lens of magnification m = pitch times px per metre: what
lies dz before or behind what is sharp is spread to (m^2 / N) |dz| / pitch; N is that of the image's
side. Such a lens has no pinhole that a focus could be told from: it is focused best.

The mirrors are strongly curved, so all that is farther than half a metre has nearly one disc for
each image radius; focused best means that the largest of these is least. Domain: convex central
mirrors, P > 0 (a plane has P = 0 and adds no blur of its own; of a concave one, which images before
itself, the signs would change: there is none here); points outside the mirror. Beyond the rim,
where the lens sees no mirror, the rim's disc. Source: derived here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.image_scale import visible_radii_px
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.medium.vignetting import inverse_focal_length
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary

# Discs are smooth in the radius: so many steps find the largest to 1e-4.
_NUM_RADII = 257
# A thing that reaches into the mirror is not nearer than this to it; only so that nothing is
# divided by 0, of what nobody can see.
_MIN_DENOMINATOR = 1e-6


@dataclass(frozen=True, slots=True)
class Aperture:
    """f_number: focal length over diameter. pixel_pitch_m: from one pixel's middle to the next.

    focus_m: what depth from the pinhole is sharp; 0: where the largest disc of all that is far away
    is least.
    """

    f_number: float
    pixel_pitch_m: float
    focus_distance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class CircleOfConfusion:
    """The signed diameter of discs, px: fixed + near / (power range + offset). Arrays broadcast.

    range is from the effective viewpoint. A negative one is that of what lies behind the focus.
    """

    infinity_diameter_px: Floats
    near_px: Floats
    power_per_m: Floats
    offset: Floats

    def near_term_px(self, range_m: Floats) -> Floats:
        """Return what a range adds to the signed diameter of infinity, 0 or more."""
        nearness = np.maximum(self.power_per_m * range_m + self.offset, _MIN_DENOMINATOR)
        added: Floats = self.near_px / nearness
        return added

    def diameter_px(self, range_m: Floats) -> Floats:
        """Return the diameter of the disc of what is in a range; of infinity the fixed part."""
        diameter: Floats = np.abs(self.infinity_diameter_px + self.near_term_px(range_m))
        return diameter


@dataclass(frozen=True, slots=True, eq=False)
class _VirtualImage:
    """What the lens sees of infinity: (n,) image radii.

    rho_m, power_per_m: of the mirror. cos_psi: of the ray to the lens. sharpness: 1/Z of the
    virtual image, or of an orthographic camera its height along the axis.
    """

    rho_m: Floats
    power_per_m: Floats
    cos_psi: Floats
    focus_coordinate: Floats


def virtual_image_depth_m(camera: OmniCamera, t: Floats, distance_m: Floats) -> Floats:
    """Return how far along the axis from the pinhole the lens sees what is before the mirror.

    t: tan(theta / 2); distance_m: from the mirror's point, inf allowed. Domain: a camera with a
    pinhole.
    """
    r, z = camera.mirror.surface_point(t)
    rho, depth = np.hypot(r, z), camera.mirror.pinhole_distance_m - z
    q = np.hypot(r, depth)
    behind: Floats = 1.0 / (1.0 / distance_m + (1.0 / rho - 1.0 / q))
    return depth + behind * depth / q


def _virtual_image_of_infinity(camera: OmniCamera, radius_px: Floats) -> _VirtualImage:
    """Return what is seen of infinity at image radii up to the rim."""
    t = camera.mirror.t_from_radius_ratio(radius_px / camera.horizon_radius_px)
    r, z = camera.mirror.surface_point(t)
    rho = np.hypot(r, z)
    if math.isinf(camera.mirror.pinhole_distance_m):
        return _VirtualImage(rho, 1.0 / rho, np.ones_like(rho), z - rho)
    depth = camera.mirror.pinhole_distance_m - z
    q = np.hypot(r, depth)
    sharpness = 1.0 / virtual_image_depth_m(camera, t, np.array(math.inf))
    return _VirtualImage(rho, 1.0 / rho - 1.0 / q, depth / q, sharpness)


def lens_focus_coordinate(aperture: Aperture, camera: OmniCamera) -> float:
    """Return 1/Z_f of what is sharp, or of an orthographic camera its height along the axis."""
    if aperture.focus_distance_m > 0.0 and not math.isinf(camera.mirror.pinhole_distance_m):
        return 1.0 / aperture.focus_distance_m
    sharpness = _virtual_image_of_infinity(camera, sample_radii_px(camera)).focus_coordinate
    return 0.5 * float(sharpness.min() + sharpness.max())


def sample_radii_px(camera: OmniCamera) -> Floats:
    """Return the image radii at which bounds are looked for."""
    return np.linspace(*visible_radii_px(camera), _NUM_RADII)


def _px_per_focus_coordinate(
    aperture: Aperture, camera: OmniCamera, focus_coordinate: float
) -> float:
    """Return the disc's diameter over the distance from the focus, in the image's measure."""
    if math.isinf(camera.mirror.pinhole_distance_m):
        rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
        px_per_m = camera.rim_radius_px / rim_m
        return px_per_m**2 * aperture.pixel_pitch_m / aperture.f_number
    focal_px = 1.0 / inverse_focal_length(camera)
    focal_m = 1.0 / (1.0 / (focal_px * aperture.pixel_pitch_m) + focus_coordinate)
    return focal_m / aperture.f_number * focal_px


def circle_of_confusion(
    aperture: Aperture, camera: OmniCamera, radius_px: Floats
) -> CircleOfConfusion:
    """Return the law of the discs at image radii."""
    image = _virtual_image_of_infinity(camera, np.minimum(radius_px, camera.rim_radius_px))
    focused = lens_focus_coordinate(aperture, camera)
    gain = _px_per_focus_coordinate(aperture, camera, focused)
    # What a thing at a distance D brings nearer than infinity: (cos(psi) / P) / (1 + P D), and
    # 1/Z of that.
    nearer = image.cos_psi / image.power_per_m
    shift, slope = image.focus_coordinate * nearer, np.square(image.focus_coordinate)
    if math.isinf(camera.mirror.pinhole_distance_m):
        shift, slope = np.zeros_like(nearer), np.ones_like(nearer)
    return CircleOfConfusion(
        infinity_diameter_px=gain * (image.focus_coordinate - focused),
        near_px=gain * slope * nearer,
        power_per_m=image.power_per_m,
        offset=1.0 - image.power_per_m * image.rho_m - shift,
    )


@lru_cache(maxsize=16)
def max_diameter_px(aperture: Aperture, camera: OmniCamera) -> float:
    """Return the largest disc of all that can be: of infinity, or of what touches the mirror."""
    radius = sample_radii_px(camera)
    law = circle_of_confusion(aperture, camera, radius)
    rho_m = _virtual_image_of_infinity(camera, radius).rho_m
    return float(np.maximum(np.abs(law.infinity_diameter_px), law.diameter_px(rho_m)).max())


@lru_cache(maxsize=4)
def circle_of_confusion_map(aperture: Aperture, camera: OmniCamera) -> CircleOfConfusion:
    """Return the law of every pixel's middle; (h, w) arrays."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    law = circle_of_confusion(aperture, camera, np.hypot(u[None, :], v[:, None]))
    for values in (law.infinity_diameter_px, law.near_px, law.power_per_m, law.offset):
        values.setflags(write=False)
    return law


@lru_cache(maxsize=4)
def interior_mask(camera: OmniCamera) -> Bools:
    """Return the (h, w) pixels that see the mirror with their whole square."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    whole: Bools = u[None, :] ** 2 + v[:, None] ** 2 < interior_radius_px(camera) ** 2
    whole.setflags(write=False)
    return whole


def interior_radius_px(camera: OmniCamera) -> float:
    """Return up to which image radius of its middle a pixel sees the mirror wholly."""
    return camera.rim_radius_px - math.sqrt(0.5)


def min_distance_at_radius(summary: SceneSummary, camera: OmniCamera, radius_px: Floats) -> Floats:
    """Return how near at least is what is seen at image radii; on a border of rings the nearer."""
    place = radius_px / camera.rim_radius_px * NUM_RINGS
    nearest = np.array(summary.visible_min_distances_m)
    inner = np.clip(np.ceil(place) - 1.0, 0, NUM_RINGS - 1).astype(np.intp)
    outer = np.clip(np.floor(place), 0, NUM_RINGS - 1).astype(np.intp)
    at_least: Floats = np.minimum(nearest[inner], nearest[outer])
    return at_least


def describe_lens(aperture: Aperture, camera: OmniCamera) -> str:
    """Return the lens in words."""
    if math.isinf(camera.mirror.pinhole_distance_m):
        return f"F/{aperture.f_number:g}, telecentric"
    focus_mm = 1e3 / lens_focus_coordinate(aperture, camera)
    return f"F/{aperture.f_number:g}, focused at {focus_mm:.0f} mm"
