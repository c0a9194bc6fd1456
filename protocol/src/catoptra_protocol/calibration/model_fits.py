"""One camera in the models of the calibration formats, as their readers make it: exactly or fitted.

Exactly where the camera is one of the model, else by a fit to its whole image; its picture flipped.
A fit minimises the differences of image radii in pixels on rings from the centre to the rim; the
image plane keeps its centre and stretch. `compute_residual` says how good the fit is over the whole
image.

Unified spheres are Mei's model, exactly. With t = tan(theta / 2) Mei's radius is 2 t / ((1 + xi) +
(xi - 1) t^2): a hyperbolic mirror has xi = s / (k - 1) and gamma = h xi, a parabolic one and a
stereographic lens have xi = 1. UCM and EUCM with beta = 1 have xi = alpha / (1 - alpha), double
spheres are unified with alpha = 0 or xi = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from catoptra_protocol.calibration.calibrated_camera import place_camera
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    FThetaLens,
    KannalaBrandtLens,
    OCamLens,
    StereographicLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class UnifiedParameters:
    """Mei's parameters of a camera."""

    xi: float
    gamma_px: float
    """Focal length of the plane behind the sphere."""
    k1: float = 0.0
    k2: float = 0.0

    @property
    def is_distorted(self) -> bool:
        """Whether the plane is distorted radially."""
        return self.k1 != 0.0 or self.k2 != 0.0

    @property
    def alpha(self) -> float:
        """Parameter of UCM, EUCM and double sphere, xi / (1 + xi)."""
        return self.xi / (1.0 + self.xi)

    @property
    def focal_length_px(self) -> float:
        """Focal length of UCM, EUCM and double sphere, gamma / (1 + xi)."""
        return self.gamma_px / (1.0 + self.xi)


def unified_parameters(camera: OmniCamera) -> UnifiedParameters:
    """Mei's parameters of a camera.

    Raises:
        DomainError: The projection is no unified sphere.
    """
    scale_px = camera.scale_px
    match camera.projection:
        case HyperbolicMirror() as mirror:
            return UnifiedParameters(mirror.xi, scale_px * mirror.xi)
        case ParabolicMirror():
            return UnifiedParameters(1.0, scale_px)
        case StereographicLens():
            return UnifiedParameters(1.0, 2.0 * scale_px)
        case UnifiedLens(xi, k1, k2):
            return UnifiedParameters(xi, scale_px, k1, k2)
        case EnhancedUnifiedLens(alpha, beta) if beta == 1.0 and alpha < 1.0:
            return _from_alpha(alpha, scale_px)
        case DoubleSphereLens(xi, alpha) if xi == 0.0:
            return _from_alpha(alpha, scale_px)
        case DoubleSphereLens(xi, alpha) if alpha == 0.0 and xi >= 0.0:
            return UnifiedParameters(xi, scale_px)
    raise DomainError(f"{type(camera.projection).__name__} is no unified sphere")


def _from_alpha(alpha: float, focal_length_px: float) -> UnifiedParameters:
    xi = alpha / (1.0 - alpha)
    assert math.isfinite(xi), "alpha is below 1"
    return UnifiedParameters(xi, focal_length_px * (1.0 + xi))


Pixels = npt.NDArray[np.uint8]

_GRID = 317
"""Pixels along the image's sides: 1e5 in all."""


@dataclass(frozen=True, slots=True)
class Residual:
    """Difference of a model from the true one."""

    max_px: float
    rms_px: float
    max_deg: float
    rms_deg: float
    fraction_missing: float
    """Of the true model's image: pixels to which the other model assigns no direction."""


# Formats with one model, and fits of several degrees, are compared with the camera once.
@lru_cache(maxsize=64)
def compute_residual(truth: OmniCamera, model: OmniCamera) -> Residual:
    """Residual at a grid of pixels of the image, the border of its domain included."""
    truth, model = (camera.with_picture(Picture.FLIPPED) for camera in (truth, model))
    pixels, turned = _turned_rays(truth, model.image_up_azimuth_rad - truth.image_up_azimuth_rad)
    found, shown = model.pixel_from_direction(turned)
    back, seen = model.direction_from_pixel(pixels)
    both = shown & seen
    if not both.any():
        return Residual(math.inf, math.inf, 180.0, 180.0, 1.0)
    px = np.linalg.norm(found - pixels, axis=-1)[both]
    # Of small angles the chord is exact where a cosine has no digits.
    chord = np.linalg.norm(back - turned, axis=-1)[both]
    deg = np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
    return Residual(
        float(px.max()),
        float(np.sqrt(np.mean(px**2))),
        float(deg.max()),
        float(np.sqrt(np.mean(deg**2))),
        1.0 - float(both.mean()),
    )


@lru_cache(maxsize=2)
def _turned_rays(truth: OmniCamera, azimuth_rad: float) -> tuple[Floats, Floats]:
    """Pixels (n, 2) of the grid that a camera shows, and their directions (n, 3), turned."""
    pixels = _grid(truth).reshape(-1, 2)
    direction, valid = truth.direction_from_pixel(pixels)
    return pixels[valid], _turn(direction[valid], azimuth_rad)


def _grid(camera: OmniCamera) -> Floats:
    """(317, 317, 2) pixels of the whole image."""
    u, v = (np.linspace(0.0, side, _GRID) for side in (camera.width_px, camera.height_px))
    return np.stack(np.meshgrid(u, v), axis=-1)


def draw_difference(truth: OmniCamera, model: OmniCamera, max_px: float) -> Pixels:
    """Picture (317, 317, 3) of the difference over the image: black to yellow at `max_px`.

    Grey where no camera has a direction, magenta where only the true one has.
    """
    truth, model = (camera.with_picture(Picture.FLIPPED) for camera in (truth, model))
    pixels = _grid(truth)
    direction, valid = truth.direction_from_pixel(pixels)
    turned = _turn(direction, model.image_up_azimuth_rad - truth.image_up_azimuth_rad)
    found, shown = model.pixel_from_direction(turned)
    off_px = np.linalg.norm(found - pixels, axis=-1)
    level = np.minimum(off_px / max_px if max_px > 0.0 else 0.0 * off_px, 1.0)
    image = np.stack((255.0 * np.sqrt(level), 255.0 * level, 0.0 * level), axis=-1)
    image[~shown] = 255.0, 0.0, 255.0
    image[~valid] = 90.0
    picture: Pixels = np.rint(image).astype(np.uint8)
    return picture


def _turn(direction: Floats, azimuth_rad: float) -> Floats:
    """Directions turned by the difference of two frames: the azimuths of their images' tops."""
    c, s = math.cos(azimuth_rad), math.sin(azimuth_rad)
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack((c * x - s * y, s * x + c * y, z), axis=-1)


_OCAM_DEGREES, _GOOD_PX = range(4, 9), 0.005
# Rings of the image on which radii are compared.
_NUM_RINGS = 1001
_NUM_KANNALA_BRANDT_TERMS = 4
_MAX_STEPS = 100
# Relative step of a difference quotient, and of the last improvement of a fit.
_DIFFERENCE, _SMALL = 1e-6, 1e-13


def fit_mei(camera: OmniCamera) -> OmniCamera:
    """The camera as Mei's unified model with two terms of radial distortion."""
    exact = _find_sphere(camera)
    if exact is not None:
        return _replace(camera, UnifiedLens(exact.xi, exact.k1, exact.k2), exact.gamma_px)
    return _fit(camera, UnifiedLens, (1.0, 0.0, 0.0))


def fit_eucm(camera: OmniCamera) -> OmniCamera:
    """The camera as EUCM; beta is 1 where it is a unified sphere without distortion."""
    if isinstance(camera.projection, EnhancedUnifiedLens):
        return camera
    exact = _find_sphere(camera)
    if exact is not None and not exact.is_distorted:
        return _replace(camera, EnhancedUnifiedLens(exact.alpha), exact.focal_length_px)
    return _fit(camera, EnhancedUnifiedLens, (0.5, 1.0))


def fit_double_sphere(camera: OmniCamera) -> OmniCamera:
    """The camera as double sphere; with xi = 0 where it is a unified sphere without distortion.

    With alpha = 0 in place of xi the pixels would be the same, but readers end their domain early.
    """
    if isinstance(camera.projection, DoubleSphereLens) and camera.projection.alpha > 0.0:
        return camera
    exact = _find_sphere(camera)
    if exact is not None and not exact.is_distorted:
        return _replace(camera, DoubleSphereLens(0.0, exact.alpha), exact.focal_length_px)
    return _fit(camera, DoubleSphereLens, (0.0, 0.5))


def fit_ucm(camera: OmniCamera) -> OmniCamera:
    """The camera as UCM: EUCM with beta = 1."""
    exact = _find_sphere(camera)
    if exact is not None and not exact.is_distorted:
        return _replace(camera, EnhancedUnifiedLens(exact.alpha), exact.focal_length_px)
    return _fit(camera, EnhancedUnifiedLens, (0.5,))


def fit_pinhole(camera: OmniCamera) -> OmniCamera:
    """The camera as a flat image with two terms of radial distortion: Mei's model with xi = 0."""
    exact = _find_sphere(camera)
    if exact is not None and exact.xi == 0.0:
        return _replace(camera, UnifiedLens(0.0, exact.k1, exact.k2), exact.gamma_px)
    if camera.rim_rad >= 0.5 * math.pi:
        raise DomainError("a flat image ends before 90 deg from the axis")
    return _fit(camera, partial(UnifiedLens, 0.0), (0.0, 0.0))


def fit_kannala_brandt(camera: OmniCamera) -> OmniCamera:
    """The camera as Kannala and Brandt's polynomial of the angle with four terms."""
    if isinstance(camera.projection, KannalaBrandtLens):
        return camera
    theta, radius_px = _rings(camera)
    powers = 2 * np.arange(_NUM_KANNALA_BRANDT_TERMS + 1) + 1
    focal_px, *terms = _solve(theta[:, None] ** powers, radius_px)
    if focal_px <= 0.0:
        raise DomainError(f"a focal length of {focal_px:.3g} px is none of a camera")
    return _replace(camera, KannalaBrandtLens(*(term / focal_px for term in terms)), focal_px)


def fit_woodscape(camera: OmniCamera) -> OmniCamera:
    """The camera as WoodScape's polynomial of the angle, in pixels."""
    if isinstance(camera.projection, WoodScapeLens):
        return camera
    theta, radius_px = _rings(camera)
    return _replace(camera, WoodScapeLens(*_solve(theta[:, None] ** np.arange(1, 5), radius_px)), 1)


def fit_f_theta(camera: OmniCamera) -> OmniCamera:
    """The camera as NVIDIA's polynomial of the image radius, of degree 4."""
    if isinstance(camera.projection, FThetaLens):
        return camera
    theta, radius_px = _rings(camera)
    # Differences of angles count by the pixels that they displace. In radii of the rim: powers of
    # hundreds of pixels have no digits.
    unit_px = camera.rim_radius_px
    weight = camera.radius_slope_px(np.tan(0.5 * theta))
    columns = (radius_px / unit_px)[:, None] ** np.arange(1, 5)
    terms = _solve(columns * weight[:, None], theta * weight)
    scaled = [term / unit_px**power for power, term in enumerate(terms, 1)]
    return _replace(camera, FThetaLens(*scaled), 1)


def fit_ocam(camera: OmniCamera, *, degree: int) -> OmniCamera:
    """The camera as OCamCalib's polynomial of the ray's height, a1 = 0.

    Args:
        camera: The camera.
        degree: Highest power of the image radius, 2 or more.
    """
    if isinstance(camera.projection, OCamLens) and len(camera.projection.polynomial) <= degree + 1:
        return camera
    theta, radius_px = _rings(camera)
    unit_px = camera.rim_radius_px
    rho = radius_px / unit_px
    height = rho / np.tan(theta)
    # A difference of height turns the ray by sin^2(theta) / rho of it.
    slope_px = camera.radius_slope_px(np.tan(0.5 * theta))
    weight = np.square(np.sin(theta)) / rho * slope_px
    powers = np.array([0, *range(2, degree + 1)])
    terms = _solve(rho[:, None] ** powers * weight[:, None], height * weight)
    polynomial = np.zeros(degree + 1)
    polynomial[powers] = [
        term * unit_px ** (1 - power) for term, power in zip(terms, powers.tolist(), strict=True)
    ]
    return _replace(camera, OCamLens(tuple(polynomial.tolist())), 1)


def fit_ocam_of_any_degree(camera: OmniCamera) -> OmniCamera:
    """The same of the lowest degree, from 4 on, that is good enough, or the best."""
    if isinstance(camera.projection, OCamLens):
        return camera
    best, best_px = camera, math.inf
    for degree in _OCAM_DEGREES:
        fitted = fit_ocam(camera, degree=degree)
        max_px = compute_residual(camera, fitted).max_px
        if max_px < best_px:
            best, best_px = fitted, max_px
        if best_px <= _GOOD_PX:
            break
    if best is camera:
        raise DomainError("no polynomial of rays describes the camera")
    return best


def _find_sphere(camera: OmniCamera) -> UnifiedParameters | None:
    try:
        return unified_parameters(camera)
    except DomainError:
        return None


def _rings(camera: OmniCamera) -> tuple[Floats, Floats]:
    """Angles and image radii of rings that are evenly spaced in pixels, without the centre."""
    radius_px = np.linspace(0.0, camera.rim_radius_px, _NUM_RINGS)[1:]
    return 2.0 * np.arctan(camera.t_from_radius_px(radius_px)), radius_px


def _solve(columns: Floats, values: Floats) -> list[float]:
    """Coefficients of columns by least squares."""
    # Columns of like size: powers of an angle are not.
    size = np.linalg.norm(columns, axis=0)
    solution = np.linalg.lstsq(columns / size, values, rcond=None)[0] / size
    return [float(value) for value in solution]


def _replace(camera: OmniCamera, projection: RadialProjection, scale_px: float) -> OmniCamera:
    """The camera with another projection, as a reader of its file makes it: up to the image's
    corners or to the end of the model.
    """
    flipped = camera.with_picture(Picture.FLIPPED)
    is_unified = isinstance(projection, UnifiedLens)
    plane = camera.plane if is_unified else replace(camera.plane, p1=0.0, p2=0.0)
    size_px = (camera.width_px, camera.height_px)
    return place_camera(projection, size_px, flipped.centre_px, scale_px, plane)


def _fit(
    camera: OmniCamera, make: Callable[..., RadialProjection], start: Sequence[float]
) -> OmniCamera:
    """Camera of a model that is not linear in its parameters: Levenberg and Marquardt's method.

    Args:
        camera: The camera.
        make: Makes the projection of some parameters.
        start: Parameters to begin with, of a model that reaches 180 degrees.

    Raises:
        DomainError: A camera whose rim is so near 180 degrees that its radius there is not finite.
    """
    theta, radius_px = _rings(camera)
    t = np.tan(0.5 * theta)

    def differences(parameters: Floats) -> Floats | None:
        scale_px, *shape = (float(value) for value in parameters)
        try:
            # At the far end of a model's domain radii grow without bound.
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                found = scale_px * make(*shape).radius_ratio_from_t(t) - radius_px
        except DomainError:
            return None
        return found if np.isfinite(found @ found) else None

    on_axis = np.array(0.0)
    slope = float(make(*start).radius_ratio_slope(on_axis))
    parameters = np.array((float(camera.radius_slope_px(on_axis)) / slope, *start))
    error = differences(parameters)
    if error is None:
        raise DomainError("the model does not reach this camera's rim at a finite radius")
    damping = 1e-3
    for _ in range(_MAX_STEPS):
        jacobian = _difference_quotients(differences, parameters, error)
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ error
        try:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient)
            following = differences(parameters - step)
        except np.linalg.LinAlgError:
            # Parameters that change nothing here, as at the end of a model's domain: a larger
            # damping makes the matrix regular.
            following = None
        if following is None or not following @ following < error @ error:
            damping *= 10.0
            if damping > 1e12:
                break
            continue
        gain = 1.0 - (following @ following) / (error @ error)
        parameters, error, damping = parameters - step, following, damping * 0.1
        if gain < _SMALL:
            break
    scale_px, *shape = (float(value) for value in parameters)
    return _replace(camera, make(*shape), scale_px)


def _difference_quotients(
    differences: Callable[[Floats], Floats | None], parameters: Floats, error: Floats
) -> Floats:
    """Derivatives of the differences by the parameters; 0 where neither side has any."""
    columns = np.zeros((len(error), len(parameters)))
    for index, value in enumerate(parameters):
        for sign in (1.0, -1.0):
            moved = parameters.copy()
            moved[index] += sign * _DIFFERENCE * max(abs(value), 1.0)
            there = differences(moved)
            if there is not None:
                columns[:, index] = (there - error) / (moved[index] - value)
                break
    return columns
