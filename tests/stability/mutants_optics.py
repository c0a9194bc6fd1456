"""Mutants of the camera models, the number formats and the light sums.

Each mutant replaces a function of the product and must fail a case of its group.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.trace.reference.reference_engine import mean_pixels
from catoptra_server.world.world_description import PointLight, srgb_from_linear
from stability.mutations import Mutation

Floats = Any
HYPERBOLIC = "catoptra_protocol.optics.mirrors.hyperbolic.HyperbolicMirror"
PARABOLIC = "catoptra_protocol.optics.mirrors.parabolic.ParabolicMirror"
CAMERA = "catoptra_protocol.optics.omni_camera"
CUBE = "catoptra_protocol.optics.cube_map"
LENS = "catoptra_protocol.optics.perspective_camera.PerspectiveCamera"
NUMBERS = "catoptra_protocol.usarsim.value_format"
PIXELS = "catoptra_server.render.trace.reference.reference_engine.encode_pixels"


# Image radius of a mirror.


def radius_by_angle(mirror: HyperbolicMirror, t: Floats) -> Floats:
    """r / h = sin(theta) / (1 + cos(theta) / xi)."""
    theta = 2.0 * np.arctan(t)
    return np.sin(theta) / (1.0 + np.cos(theta) / mirror.xi)


def radius_by_eq2(mirror: HyperbolicMirror, t: Floats) -> Floats:
    return t


def radius_without_guard(mirror: HyperbolicMirror, t: Floats) -> Floats:
    """One less kappa squared t squared, without a domain."""
    kappa = 1.0 / (mirror.k - 1.0 + math.sqrt(mirror.k * (mirror.k - 2.0)))
    s = math.sqrt(mirror.k * (mirror.k - 2.0))
    return 2.0 * s * kappa * t / (1.0 - (kappa * t) ** 2)


def radius_by_surface(mirror: HyperbolicMirror, t: Floats) -> Floats:
    """r by the polar form, z by c / 2 - sqrt(...), then projected."""
    k, theta = mirror.k, 2.0 * np.arctan(t)
    r = np.sin(theta) / (mirror.s * (1.0 + math.sqrt(k / (k - 2.0)) * np.cos(theta)))
    z = 0.5 - np.sqrt(0.25 * (k - 2.0) / k + r * r * (0.5 * k - 1.0))
    return mirror.s * r / (1.0 - z)


def incidence_by_root(mirror: HyperbolicMirror, ratio: Floats) -> Floats:
    """(-1 + sqrt(1 + y^2)) / (kappa y): cancels at the centre, 0 / 0 on it."""
    y = ratio / mirror.s
    return (np.sqrt(1.0 + y * y) - 1.0) / (mirror.kappa * y)


def incidence_by_tangents(mirror: HyperbolicMirror, ratio: Floats) -> Floats:
    """tan(atan(r / f) / 2) / kappa, kappa as a difference."""
    kappa = mirror.k - 1.0 - mirror.s
    return np.tan(0.5 * np.arctan(ratio / mirror.s)) / kappa


def slope_by_difference(mirror: HyperbolicMirror, t: Floats) -> Floats:
    theta = 2.0 * np.arctan(t)
    high, low = (radius_by_angle(mirror, np.tan(0.5 * (theta + d))) for d in (1e-6, -1e-6))
    return (high - low) / 2e-6


# The mirror's surface.


def surface_by_root(mirror: HyperbolicMirror, t: Floats) -> tuple[Floats, Floats]:
    """z = c / 2 - sqrt(a^2 + r^2 (k / 2 - 1))."""
    k, c = mirror.k, mirror.c_m
    r = 2.0 * mirror.vertex_height_m * t / (1.0 - mirror.kappa * t * t)
    return r, 0.5 * c - np.sqrt(0.25 * c * c * (k - 2.0) / k + r * r * (0.5 * k - 1.0))


def surface_by_polar_form(mirror: HyperbolicMirror, t: Floats) -> tuple[Floats, Floats]:
    """rho = l / (1 + e cos(theta)), with sines and cosines of 2 atan(t)."""
    theta = 2.0 * np.arctan(t)
    latus, e = mirror.c_m / mirror.s, math.sqrt(mirror.k / (mirror.k - 2.0))
    rho = latus / (1.0 + e * np.cos(theta))
    return rho * np.sin(theta), rho * np.cos(theta)


def paraboloid_by_squares(mirror: ParabolicMirror, t: Floats) -> tuple[Floats, Floats]:
    """z = (p^2 - r^2) / 2p."""
    p = mirror.horizon_radius_m
    return p * t, (p * p - (p * t) ** 2) / (2.0 * p)


# Directions and pixels.


def half_angle_by_arc_cosine(direction: Floats) -> tuple[Floats, Floats]:
    """tan(acos(z / |d|) / 2)."""
    norm = np.sqrt((direction * direction).sum(axis=-1))
    return np.tan(0.5 * np.arccos(direction[..., 2] / norm)), np.isfinite(norm)


def half_angle_by_one_form(direction: Floats) -> tuple[Floats, Floats]:
    """sin / (1 + cos) in both hemispheres."""
    x, y, z = direction
    rho = np.hypot(x, y)
    denominator = np.hypot(rho, z) + z
    valid = np.isfinite(rho) & (denominator > 0.0)
    return np.where(valid, rho / np.where(valid, denominator, 1.0), 0.0), valid


def pixel_by_azimuth(camera: OmniCamera, direction: Floats) -> tuple[Floats, Floats]:
    """Angles, sines and cosines; directions beyond the rim are clamped without a word."""
    x, y, z = direction
    theta = np.minimum(np.arctan2(np.sqrt(x * x + y * y), z), camera.rim_rad)
    azimuth = np.arctan2(y, x) - camera.image_up_azimuth_rad
    radius = camera.scale_px * camera.projection.radius_ratio_from_t(np.tan(0.5 * theta))
    u, v = -radius * np.sin(azimuth), -radius * np.cos(azimuth)
    return np.stack((u, v), axis=-1) + camera.centre_px, np.bool_(True)


def direction_by_normalising(camera: OmniCamera, pixel: Floats) -> tuple[Floats, Floats]:
    """Divide by the radius, zero at the centre."""
    du, dv = (np.asarray(pixel) - camera.centre_px) / camera.scale_px
    radius = np.sqrt(du * du + dv * dv)
    t = camera.projection.t_from_radius_ratio(radius)
    theta, up = 2.0 * np.arctan(t), camera.image_up_azimuth_rad
    x = np.sin(theta) * (math.sin(up) * du - math.cos(up) * dv) / radius
    y = -np.sin(theta) * (math.cos(up) * du + math.sin(up) * dv) / radius
    return np.stack((x, y, np.cos(theta)), axis=-1), t <= camera.rim_t


def face_by_last(direction: Floats) -> Floats:
    """Last instead of first of equal faces."""
    ahead = direction @ MIRROR_FROM_FACE_ROTATIONS[:, :, 0].T
    return len(ahead) - 1 - np.argmax(ahead[::-1])


def face_by_largest_component(direction: Floats) -> Floats:
    """The largest absolute component, then its sign: ties of signs go to another face."""
    axis = int(np.argmax(np.abs(direction)))
    return {0: (0, 2), 1: (1, 3), 2: (4, 5)}[axis][int(direction[axis] < 0.0)]


def coordinates_without_guard(direction: Floats, face: Floats) -> Floats:
    local = np.einsum("...i,...ij->...j", direction, MIRROR_FROM_FACE_ROTATIONS[face])
    return local[..., 1:] / local[..., :1]


def lens_pixel_without_guard(camera: PerspectiveCamera, direction: Floats) -> tuple[Floats, Floats]:
    """y / x for every direction, behind the camera too."""
    x, y, z = direction
    u = camera.focal_length_px * y / x + 0.5 * camera.width_px
    v = camera.focal_length_px * z / x + 0.5 * camera.height_px
    inside = (0.0 <= u) & (u <= camera.width_px) & (0.0 <= v) & (v <= camera.height_px)
    return np.stack((u, v), axis=-1), inside


def lens_direction_by_angles(camera: PerspectiveCamera, pixel: Floats) -> tuple[Floats, Floats]:
    """Clamp to the image without a word."""
    u, v = np.clip(pixel, 0.0, (camera.width_px, camera.height_px))
    y, z = u - 0.5 * camera.width_px, v - 0.5 * camera.height_px
    ray = np.array([camera.focal_length_px, y, z])
    return ray / np.sqrt(ray @ ray), np.bool_(True)


# Numbers on the wire.


def format_rounded(value: float, decimals: int = 4) -> str:
    return f"{value:.{decimals}f}"


def format_truncated_after_scaling(value: float, decimals: int = 4) -> str:
    scale = 10.0**decimals
    whole = math.trunc(value * scale) if math.isfinite(value) else 0
    return f"{whole / scale:.{decimals}f}"


def format_cut_repr(value: float, decimals: int = 4) -> str:
    """repr, cut off: large and small numbers get an exponent."""
    whole, _, fraction = repr(value).partition(".")
    return f"{whole}.{fraction[:decimals].ljust(decimals, '0')}" if decimals else whole


def parse_by_float(text: str) -> float:
    """float(): accepts inf and nan, and rejects a trailing unit."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def round_unreal_units(angle_rad: float) -> float:
    return round(angle_rad * 10430.3783505) / 10430.3783505 if abs(angle_rad) < 1e300 else 0.0


def metres_by_two_steps(length_uu: float) -> float:
    return length_uu * 4.0 / 1000.0


# Light.


def encode_without_clip(linear: Floats) -> Floats:
    return 1.055 * np.abs(linear) ** (1.0 / 2.4) - 0.055


def average_encoded(radiance: Floats, samples: int) -> Floats:
    """Mean of encoded samples, as averaging finished images would compute."""
    return np.rint(mean_pixels(255.0 * srgb_from_linear(radiance), samples))


def average_clipped(radiance: Floats, samples: int) -> Floats:
    """Mean of samples that are clipped one by one, not with their pixel."""
    clipped = np.clip(radiance, 0.0, 1.0)
    return np.rint(255.0 * srgb_from_linear(mean_pixels(clipped, samples)))


def point_light_without_guard(
    lights: tuple[PointLight, ...], points: Floats, normals: Floats
) -> Floats:
    """The inverse square down to the point light itself."""
    towards = np.asarray(lights[0].position_m) - points
    distance = np.sqrt((towards * towards).sum(axis=-1))
    cosine = np.maximum((towards * normals).sum(axis=-1) / distance, 0.0)
    return (cosine / distance**2)[:, None] * np.asarray(lights[0].intensity)


def march_in_squares(radius: Floats, cosine: Floats, steps: int) -> tuple[Floats, Floats, Floats]:
    """Steps that grow as squares, their middles for all of them, through the ground."""
    middle = -radius * cosine
    far = middle + np.sqrt(middle * middle - radius * radius + 6.471e6**2)
    bounds = np.square(np.linspace(0.0, 1.0, steps + 1))
    distance = 0.5 * (bounds[1:] + bounds[:-1]) * far[..., None]
    squares = np.square(radius)[..., None] + distance * (distance - 2.0 * middle[..., None])
    height = np.maximum(np.sqrt(squares) - 6.371e6, 0.0)[..., None]
    lengths = (np.diff(bounds) * far[..., None])[..., None]
    return distance, np.exp(-height / (8e3, 1.2e3)) * lengths, np.zeros(radius.shape, bool)


RATIO, SHAPE = f"{HYPERBOLIC}.radius_ratio_from_t", f"{HYPERBOLIC}.surface_point"
INVERSE, SLOPE = f"{HYPERBOLIC}.t_from_radius_ratio", f"{HYPERBOLIC}.radius_ratio_slope"
PIXEL, RAY = f"{CAMERA}.pixel_from_direction", f"{CAMERA}.direction_from_pixel"
HALF_ANGLE = "catoptra_protocol.optics.numerics.half_angle_tangent"
FACE = f"{CUBE}.face_from_direction"
POINT_LIGHT = "catoptra_server.world.shading.point_irradiance"
ENCODE = "catoptra_server.world.world_description.srgb_from_linear"

MUTATIONS = [
    Mutation("sin / (1 + cos / xi) of the angle", "mirror", RATIO, radius_by_angle),
    Mutation("Eq. 2 for every mirror", "mirror", RATIO, radius_by_eq2),
    Mutation("1 - kappa^2 t^2, unguarded", "mirror", RATIO, radius_without_guard),
    Mutation("c / 2 - sqrt, then projected", "mirror", RATIO, radius_by_surface),
    Mutation("sqrt(1 + y^2) - 1", "mirror", INVERSE, incidence_by_root),
    Mutation("tan of half an atan, kappa a difference", "mirror", INVERSE, incidence_by_tangents),
    Mutation("a difference quotient", "mirror", SLOPE, slope_by_difference),
    Mutation("c / 2 - sqrt(...)", "surface", SHAPE, surface_by_root),
    Mutation("l / (1 + e cos(theta))", "surface", SHAPE, surface_by_polar_form),
    Mutation("(p^2 - r^2) / 2p", "surface", f"{PARABOLIC}.surface_point", paraboloid_by_squares),
    Mutation("tan(acos(z) / 2)", "pixel", HALF_ANGLE, half_angle_by_arc_cosine),
    Mutation("sin / (1 + cos) above the horizon too", "pixel", HALF_ANGLE, half_angle_by_one_form),
    Mutation("angles, clamped at the rim", "pixel", PIXEL, pixel_by_azimuth),
    Mutation("over the radius, 0 at the centre", "pixel", RAY, direction_by_normalising),
    Mutation("the last of equal faces", "cube", FACE, face_by_last),
    Mutation("the largest absolute component", "cube", FACE, face_by_largest_component),
    Mutation("a plane behind", "cube", f"{CUBE}.face_coordinates", coordinates_without_guard),
    Mutation("y / x unguarded", "lens", f"{LENS}.pixel_from_direction", lens_pixel_without_guard),
    Mutation("clamped", "lens", f"{LENS}.direction_from_pixel", lens_direction_by_angles),
    Mutation("rounded, not truncated", "wire", f"{NUMBERS}.format_fixed_point", format_rounded),
    Mutation(
        "truncated after scaling",
        "wire",
        f"{NUMBERS}.format_fixed_point",
        format_truncated_after_scaling,
    ),
    Mutation("repr cut off", "wire", f"{NUMBERS}.format_fixed_point", format_cut_repr),
    Mutation("float()", "wire", f"{NUMBERS}.number_from_text", parse_by_float),
    Mutation(
        "rounded Unreal units", "wire", f"{NUMBERS}.truncate_to_unreal_units", round_unreal_units
    ),
    Mutation(
        "times 4 over 1000",
        "wire",
        "catoptra_server.config.camera_sections.metres_from_uu",
        metres_by_two_steps,
    ),
    Mutation("the power alone, unclipped", "light", ENCODE, encode_without_clip),
    Mutation("a mean of encoded samples", "light", PIXELS, average_encoded),
    Mutation("a clip before the mean", "light", PIXELS, average_clipped),
    Mutation("even squares", "light", "catoptra_server.world.sky._march", march_in_squares),
    Mutation(
        "a point light's inverse square unguarded", "light", POINT_LIGHT, point_light_without_guard
    ),
]
