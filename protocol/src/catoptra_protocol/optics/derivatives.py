"""Derivatives of pixels and rays: by direction or point, by the camera's pose, by its parameters.

Chain rule in one place. A projection gives the image radius of an angle, its slope and its
derivatives by its own parameters (`_differentiate_radius`); all else, the same for every model, is
here: an angle along the image radius moves the pixel by dr/dtheta, one across it by r / sin(theta),
and the image plane maps both. Inverses are those of this 2 x 2 matrix.

A point at the distance s along the ray of a mirror without a viewpoint turns that ray by the
displacement across it over s + D / (dtheta/dpsi), D the distance of the mirror's point from the
pinhole: the law of reflection alone, for every surface. The parameters of such a surface have no
derivative here, since they move the effective viewpoint, the origin of the mirror frame; those of
its image have. A perspective camera has its own frame instead of the mirror's. Domain: that of the
functions, and for inverses a slope above 0: a fold's is 0. Outside, values are those of the
functions, derivatives 0, and the mask false.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.curves import Symmetry, fit_spline
from catoptra_protocol.optics.elementary import arctan, cos, hypot, matmul, sin
from catoptra_protocol.optics.image_plane import distortion_jacobian
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    FThetaLens,
    KannalaBrandtLens,
    OCamLens,
    RadialTableLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import (
    Bools,
    Floats,
    half_angle_tangent_from_rho_z,
    scale_components,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class PixelJacobian:
    """Pixels of points or directions in the mirror frame, with their derivatives."""

    pixel: Floats
    """(..., 2) pixels; the image centre where invalid."""
    valid: Bools
    """(...) whether the camera shows the point."""
    by_point: Floats
    """(..., 2, 3) derivatives by the point, px/m, or by the direction, px per unit of it."""
    by_pose: Floats
    """(..., 2, 6) derivatives by a displacement (m) and a turn (rad) of the camera, both about the
    axes of the mirror frame."""
    by_parameters: Floats
    """(..., 2, n) derivatives by the parameters, in the order of `parameter_names`."""


@dataclass(frozen=True, slots=True, eq=False)
class RayJacobian:
    """Rays of pixels in the mirror frame, with their derivatives."""

    origin: Floats
    """(..., 3) metres, as of `ray_from_pixel`."""
    direction: Floats
    """(..., 3) unit directions."""
    valid: Bools
    """(...) whether the camera shows a direction that has derivatives."""
    origin_by_pixel: Floats
    """(..., 3, 2) metres per pixel."""
    by_pixel: Floats
    """(..., 3, 2) derivatives of the direction, per pixel."""
    by_parameters: Floats
    """(..., 3, n) derivatives of the direction by the parameters."""


def parameter_names(camera: OmniCamera | PerspectiveCamera) -> tuple[str, ...]:
    """Parameters of a camera that have derivatives; entries of tuples by their index.

    A table's knots are where it was measured: its first entry, 0, and their angles are none.
    """
    if isinstance(camera, PerspectiveCamera):
        return ("horizontal_fov_rad",)
    image = ("centre_u_px", "centre_v_px", "scale_px", "image_up_azimuth_rad")
    plane = ("stretch_0", "stretch_1", "stretch_2", "stretch_3", "p1", "p2")
    return (*image, *plane, *_projection_names(camera.projection))


@np.errstate(under="ignore")  # terms far below the largest component may vanish
def differentiate_direction(
    camera: OmniCamera | PerspectiveCamera, direction: Floats
) -> PixelJacobian:
    """Derivatives of `pixel_from_direction` at (..., 3) directions of any length."""
    if isinstance(camera, PerspectiveCamera):
        return _differentiate_flat_pixel(camera, direction)
    pixel, valid = pixel_from_direction(camera, direction)
    shown = np.where(valid[..., None], direction, _AHEAD)
    turn: Floats = 1.0 / hypot(shown[..., 0], shown[..., 1], shown[..., 2])
    return _Local(camera, shown, valid).differentiate_pixel(shown, pixel, turn, turn)


@np.errstate(under="ignore")
def differentiate_point(camera: OmniCamera | PerspectiveCamera, point: Floats) -> PixelJacobian:
    """Derivatives of `pixel_from_point` at (..., 3) points, metres."""
    if isinstance(camera, PerspectiveCamera) or camera.is_central:
        return differentiate_direction(camera, point)
    pixel, valid = pixel_from_point(camera, point)
    shown = np.where(valid[..., None], point, _AHEAD)
    nearby = _Local(camera, ray_from_pixel(camera, pixel)[1], valid)
    # Next to the axis a pixel has the digits of the image's centre, a step of Newton's method all.
    local = _Local(camera, nearby.turn_to(shown), valid)
    return local.differentiate_pixel(shown, pixel, *local.turns_by_point(shown)[:2])


@np.errstate(under="ignore")
def differentiate_ray(camera: OmniCamera | PerspectiveCamera, pixel: Floats) -> RayJacobian:
    """Derivatives of `ray_from_pixel` and `direction_from_pixel` at (..., 2) pixels."""
    if isinstance(camera, PerspectiveCamera):
        return _differentiate_flat_ray(camera, pixel)
    origin, direction, valid = ray_from_pixel(camera, pixel)
    local = _Local(camera, direction, valid)
    (a, b), (c, d) = np.moveaxis(local.by_angles, (-2, -1), (0, 1))
    determinant = a * d - b * c
    valid = valid & (np.abs(determinant) > 0.0)
    rows = np.stack((np.stack((d, -b), axis=-1), np.stack((-c, a), axis=-1)), axis=-2)
    inverse = rows / np.where(valid, determinant, math.inf)[..., None, None]
    axes = np.stack((local.along, local.across), axis=-1)
    by_pixel = matmul(axes, inverse)
    moved = np.zeros_like(axes)
    if not camera.is_central:
        psi, _, slope, distance = local.reflect()
        turn = arctan(local.t) + 0.5 * psi
        # The mirror's point at the distance D has d(ln D) / dpsi = tan((theta + psi) / 2).
        outwards = distance / slope / cos(turn)
        heading = 0.5 * psi - arctan(local.t)
        moved[..., :2, 0] = local.azimuth * (outwards * cos(heading))[..., None]
        moved[..., 2, 0] = outwards * sin(heading)
        moved[..., 1] = local.across * (distance * sin(psi) / local.sine_or_one)[..., None]
    by_parameters = -matmul(by_pixel, local.by_parameters)
    return RayJacobian(origin, direction, valid, matmul(moved, inverse), by_pixel, by_parameters)


def _differentiate_by_pose(by_point: Floats, point: Floats) -> Floats:
    """(..., 2, 6) derivatives by the pose, from (..., 2, 3) by the (..., 3) point."""
    # A displaced camera has p - v, a turned one p - w x p.
    by_turn = np.stack([np.cross(by_point[..., row, :], point) for row in range(2)], axis=-2)
    return np.concatenate((-by_point, by_turn), axis=-1)


def _differentiate_flat_pixel(camera: PerspectiveCamera, point: Floats) -> PixelJacobian:
    """Derivatives of (u, v) - centre = f (y, z) / x, f proportional to cot(fov / 2)."""
    pixel, valid = camera.pixel_from_direction(point)
    point = np.where(valid[..., None], point, (1.0, 0.0, 0.0))
    offset_px = pixel - camera.centre_px
    by_x = -offset_px[..., None]
    by_yz = np.broadcast_to(camera.focal_length_px * np.eye(2), (*valid.shape, 2, 2))
    shown = np.where(valid, 1.0 / point[..., 0], 0.0)[..., None, None]
    by_point = shown * np.concatenate((by_x, by_yz), axis=-1)
    by_parameters = by_x / sin(camera.horizontal_fov_rad)
    by_pose = _differentiate_by_pose(by_point, point)
    return PixelJacobian(pixel, valid, by_point, by_pose, by_parameters)


def _differentiate_flat_ray(camera: PerspectiveCamera, pixel: Floats) -> RayJacobian:
    direction, valid = camera.direction_from_pixel(pixel)
    # The direction's x is one over the length of (f, u, v) in focal lengths.
    shown = np.where(valid, direction[..., 0] / camera.focal_length_px, 0.0)[..., None, None]
    by_pixel = shown * (np.eye(3)[:, 1:] - direction[..., None] * direction[..., None, 1:])
    offset_px = np.where(valid[..., None], pixel - np.array(camera.centre_px), 0.0)
    by_parameters = matmul(by_pixel, offset_px[..., None]) / sin(camera.horizontal_fov_rad)
    origin, fixed = np.zeros_like(direction), np.zeros_like(by_pixel)
    return RayJacobian(origin, direction, valid, fixed, by_pixel, by_parameters)


# Direction of the axis, in place of directions that are not shown.
_AHEAD = (0.0, 0.0, 1.0)


class _Local:
    """A camera next to directions: (..., 2, 2) pixels by angles along and across the image radius,
    and (..., 2, n) pixels by parameters; 0 where invalid."""

    def __init__(self, camera: OmniCamera, direction: Floats, valid: Bools) -> None:
        self.camera, self.valid = camera, valid
        projection, plane = camera.projection, camera.plane
        x, y, z = scale_components(np.where(valid[..., None], direction, _AHEAD))
        rho = hypot(x, y)
        t, _ = half_angle_tangent_from_rho_z(rho, z)
        t = np.where(valid, np.clip(t, projection.t_min, camera.rim_t), projection.t_min)
        self.t = t
        off_axis = rho > 0.0
        x = np.where(off_axis, x / np.where(off_axis, rho, 1.0), 1.0)
        y = np.where(off_axis, y / np.where(off_axis, rho, 1.0), 0.0)
        one_plus = 1.0 + np.square(t)
        sine, cosine = 2.0 * t / one_plus, (1.0 - t) * (1.0 + t) / one_plus
        self.sine_or_one = np.where(t > 0.0, sine, 1.0)
        self.azimuth = np.stack((x, y), axis=-1)
        self.along = np.stack((cosine * x, cosine * y, -sine), axis=-1)
        self.across = np.stack((-y, x, np.zeros_like(x)), axis=-1)
        ca, sa = cos(camera.image_up_azimuth_rad), sin(camera.image_up_azimuth_rad)
        right, down = ca * y - sa * x, -ca * x - sa * y
        outwards, sideways = np.stack((right, down), -1), np.stack((-down, right), -1)
        # Of the plane before its distortion, and the distortion's derivative.
        if isinstance(projection, UnifiedLens):
            radius, slope = projection.undistorted_ratio_from_t(t), projection.undistorted_slope(t)
            px, py = radius * right, radius * down
            square = radius * radius
            gain, _ = projection.distortion_factor(square)
            xx, xy, yy = distortion_jacobian(projection, plane, px, py)
            distortion = np.stack((np.stack((xx, xy), -1), np.stack((xy, yy), -1)), axis=-2)
            offset = gain[..., None] * np.stack((px, py), -1) + np.stack(plane.decentre(px, py), -1)
            flat = np.stack((px, py), axis=-1)
            by_p1 = np.stack((2.0 * px * py, px * px + 3.0 * py * py), axis=-1)
            by_p2 = np.stack((3.0 * px * px + py * py, 2.0 * px * py), axis=-1)
            by_shape = [
                # m = sin / (xi + cos), whose derivative by xi is -m^2 / sin.
                matmul(distortion, outwards[..., None])[..., 0]
                * (-square / self.sine_or_one)[..., None],
                square[..., None] * flat,
                (square * square)[..., None] * flat,
            ]
        else:
            radius, slope = projection.radius_ratio_from_t(t), projection.radius_ratio_slope(t)
            distortion, offset = np.eye(2), radius[..., None] * outwards
            by_p1 = by_p2 = np.zeros_like(offset)
            by_radius = _differentiate_radius(projection, t, radius, slope)
            by_shape = [one[..., None] * outwards for one in by_radius]
        across = np.where(t > 0.0, radius / self.sine_or_one, slope)
        turned = np.stack((slope[..., None] * outwards, across[..., None] * sideways), axis=-1)
        a, b, c, d = plane.stretch
        hand = -1.0 if camera.picture is Picture.MIRRORED else 1.0
        stretch = np.array(((hand * a, hand * b), (c, d)))
        shown = np.where(valid, 1.0, 0.0)[..., None, None]
        plane_px = camera.scale_px * matmul(stretch, distortion)
        self.by_angles = shown * matmul(plane_px, turned)
        stretched = [
            offset,
            camera.scale_px
            * -matmul(distortion, (radius[..., None] * sideways)[..., None])[..., 0],
            *(camera.scale_px * one for one in (by_p1, by_p2, *by_shape)),
        ]
        scale, azimuth, *rest = np.moveaxis(matmul(stretch, np.stack(stretched, axis=-1)), -1, 0)
        ox, oy, zero = *np.moveaxis(camera.scale_px * offset, -1, 0), np.zeros_like(t)
        centre = ((zero + 1.0, zero), (zero, zero + 1.0))
        by_stretch = ((hand * ox, zero), (hand * oy, zero), (zero, ox), (zero, oy))
        first, second = ([np.stack(one, -1) for one in pairs] for pairs in (centre, by_stretch))
        columns = np.stack((*first, scale, azimuth, *second, *rest), axis=-1)
        self.by_parameters = shown * columns

    def reflect(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Camera angle, mirror's radius, d(theta) / d(psi) and distance from the pinhole."""
        mirror = self.camera.projection
        assert isinstance(mirror, NonCentralMirror), "a mirror without a viewpoint"
        psi = arctan(mirror.radius_ratio_from_t(self.t))
        found = mirror.reflect(psi)
        return psi, found.r, found.slope, hypot(found.r, found.depth)

    def turns_by_point(self, point: Floats) -> tuple[Floats, Floats, Floats]:
        """Angles of the ray along and across the image radius, per metre of a point on it, and the
        angle along it to a point beside it."""
        _, r, slope, distance = self.reflect()
        _, z = self.camera.mirror.surface_point(self.t)
        rho, height = hypot(point[..., 0], point[..., 1]), point[..., 2] - z
        theta = 2.0 * arctan(self.t)
        sine, cosine = sin(theta), cos(theta)
        along = 1.0 / ((rho - r) * sine + height * cosine + distance / slope)
        off_axis = rho > 0.0
        across = np.where(off_axis, sine / np.where(off_axis, rho, 1.0), along)
        return along, across, along * ((rho - r) * cosine - height * sine)

    def turn_to(self, point: Floats) -> Floats:
        """(..., 3) directions of the ray after a turn to a point beside it, in its azimuth."""
        theta = 2.0 * arctan(self.t) + self.turns_by_point(point)[2]
        rho = hypot(point[..., 0], point[..., 1])
        across = sin(theta) / np.where(rho > 0.0, rho, 1.0)
        return np.stack((across * point[..., 0], across * point[..., 1], cos(theta)), axis=-1)

    def differentiate_pixel(
        self, point: Floats, pixel: Floats, along: Floats, across: Floats
    ) -> PixelJacobian:
        """Derivatives at points whose rays turn by angles along and across the image radius."""
        turns = (self.along * along[..., None], self.across * across[..., None])
        by_point = matmul(self.by_angles, np.stack(turns, axis=-2))
        by_pose = _differentiate_by_pose(by_point, point)
        return PixelJacobian(pixel, self.valid, by_point, by_pose, self.by_parameters)


def _projection_names(projection: RadialProjection) -> Iterator[str]:
    if isinstance(projection, HyperbolicMirror):
        yield "k"
    elif isinstance(projection, RadialTableLens):
        yield from (f"radii_{index}" for index in range(1, len(projection.radii)))
    elif isinstance(projection, OCamLens):
        yield from (f"polynomial_{index}" for index in range(len(projection.polynomial)))
    elif not hasattr(projection, "surface_point"):
        # Every lens is a dataclass of its parameters.
        described: Any = projection
        yield from (field.name for field in fields(described))


def _differentiate_radius(
    projection: RadialProjection, t: Floats, radius: Floats, slope: Floats
) -> list[Floats]:
    """Image radius at a fixed angle by each parameter of a projection.

    Args:
        projection: any but `UnifiedLens`, on whose undistorted plane the image plane acts.
        t: half-angle tangents.
        radius: their image radii.
        slope: derivatives of the image radii by the angle.
    """
    theta, one_plus = 2.0 * arctan(t), 1.0 + np.square(t)
    sine, cosine = 2.0 * t / one_plus, (1.0 - t) * (1.0 + t) / one_plus
    # One over the denominator of r = sin / D; on the axis its factor is 0.
    across = radius / np.where(t > 0.0, sine, 1.0)
    match projection:
        case KannalaBrandtLens():
            return [_power(theta, exponent) for exponent in (3, 5, 7, 9)]
        case WoodScapeLens():
            return [_power(theta, exponent) for exponent in (1, 2, 3, 4)]
        case FThetaLens():
            # theta(r) = k1 r + ... is the same at a fixed angle.
            return [-slope * _power(radius, exponent) for exponent in (1, 2, 3, 4)]
        case OCamLens(polynomial=terms):
            height = np.polynomial.polynomial.polyval(radius, terms)
            gain = slope * radius / (np.square(radius) + np.square(height))
            return [gain * _power(radius, exponent) for exponent in range(len(terms))]
        case RadialTableLens(radii=radii):
            knots = np.minimum(np.radians(projection.angles_deg), math.pi)
            units = np.eye(len(radii))[1:]
            return [fit_spline(knots, unit, Symmetry.ODD).evaluate(theta)[0] for unit in units]
        case EnhancedUnifiedLens(alpha=alpha, beta=beta):
            d, gain, square = hypot(math.sqrt(beta) * sine, cosine), -radius * across, sine * sine
            by_beta = gain * (0.5 * alpha) * square / d
            return [gain * _excess(d, d + cosine, beta * square), by_beta]
        case DoubleSphereLens():
            _, (denominator, d2, factor), _ = projection.terms(t)
            gain = -radius * across
            return [gain * factor / d2, gain * _excess(d2, denominator + factor, sine * sine)]
        case HyperbolicMirror(k=k, xi=xi, s=s):
            # r / h = xi sin / (xi + cos), and dxi / dk = 1 / (s (k - 1)^2).
            return [radius * across * cosine / (xi * xi) / (s * (k - 1.0) * (k - 1.0))]
        case _:
            return []


def _excess(length: Floats, total: Floats, square: Floats) -> Floats:
    """length - height, of total = length + height and square = length^2 - height^2."""
    above = total > length
    return np.where(above, square / np.where(above, total, 1.0), 2.0 * length - total)


def _power(values: Floats, exponent: int) -> Floats:
    """Whole power by products."""
    result = np.ones_like(values)
    for _ in range(exponent):
        result = result * values
    return result
