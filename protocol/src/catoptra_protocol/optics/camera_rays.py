"""Rays of pixels, and pixels of points, of cameras with or without a single viewpoint.

Of a central camera all rays begin at the effective viewpoint, and a point has the pixel of its
direction. Of another mirror a ray begins at the mirror's point, and a point has the pixel whose ray
meets it: the one root of the cross product of ray and displacement along the image radius, which is
monotone for convex mirrors and points before them.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.elementary import arctan, arctan2, hypot, tan
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    direction_from_pixel_grid,
    pixel_from_direction,
)

# Bisections of the image radius: 2^-52 of the rim's.
_BISECTIONS = 52
# Beside a root a bisection ends 1e-15 of the rim's radius away, seen from 1e-9 m.
_MAX_TURN_RAD = 1e-6
# Error of a scene at the near limit, in pixels, by the central approximation.
CENTRAL_ERROR_PX = 0.25
_NUM_RINGS = 257


def rays_from_pixel_grid(
    camera: OmniCamera, u: Floats, v: Floats
) -> tuple[Floats | None, Floats, Bools]:
    """Rays of all pixels of a grid in the mirror frame.

    Args:
        camera: the camera model.
        u: (w,) columns.
        v: (h,) rows.

    Returns:
        (h, w, 3) origins, metres, None for a central camera, whose rays begin at the viewpoint;
            (h, w, 3) unit directions; (h, w) validity.
    """
    directions, valid = direction_from_pixel_grid(camera, u, v)
    if camera.is_central:
        return None, directions, valid
    mirror = _non_central(camera)
    if camera.plane.is_radial:
        r, z = _surface_of_grid(camera, mirror, u, v)
    else:
        # By the angle, which includes the image plane, at the price of an inverse a sample.
        r, z = _surface_of_directions(mirror, directions, valid)
    return _place_origins(directions, valid, r, z), directions, valid


def ray_from_pixel(camera: OmniCamera, pixel: Floats) -> tuple[Floats, Floats, Bools]:
    """Rays of pixels in the mirror frame.

    Args:
        camera: the camera model.
        pixel: (..., 2) pixels.

    Returns:
        (..., 3) origins, metres: the mirror's points, or the viewpoint of a central camera;
            (..., 3) unit directions; a (...) mask. Invalid rays begin at the viewpoint.
    """
    directions, valid = direction_from_pixel(camera, pixel)
    if camera.is_central:
        return np.zeros_like(directions), directions, valid
    r, z = _surface_of_directions(_non_central(camera), directions, valid)
    return _place_origins(directions, valid, r, z), directions, valid


def _surface_of_directions(
    mirror: NonCentralMirror, directions: Floats, valid: Bools
) -> tuple[Floats, Floats]:
    """(...) r and z of the mirror's points that reflect unit (..., 3) directions."""
    rho = hypot(directions[..., 0], directions[..., 1])
    theta = arctan2(rho, directions[..., 2])
    t = np.clip(tan(0.5 * theta), mirror.t_min, mirror.t_limit)
    return mirror.surface_point(np.where(valid, t, mirror.t_min))


def _place_origins(directions: Floats, valid: Bools, r: Floats, z: Floats) -> Floats:
    """(..., 3) points of the mirror in the azimuths of directions; the viewpoint where invalid."""
    rho = hypot(directions[..., 0], directions[..., 1])
    scale = np.where(valid, r, 0.0) / np.where(rho > 0.0, rho, 1.0)
    origins = np.empty_like(directions)
    origins[..., 0] = scale * directions[..., 0]
    origins[..., 1] = scale * directions[..., 1]
    origins[..., 2] = np.where(valid, z, 0.0)
    return origins


def _surface_of_grid(
    camera: OmniCamera, mirror: NonCentralMirror, u: Floats, v: Floats
) -> tuple[Floats, Floats]:
    """(h, w) r and z of the mirror's points that pixels of a grid show.

    As in `direction_from_pixel_grid`, once for all pixels at the same distances from the centre.
    """
    to_u, columns = np.unique(np.abs(u - camera.centre_px[0]), return_inverse=True)
    to_v, rows = np.unique(np.abs(v - camera.centre_px[1]), return_inverse=True)
    ratio = hypot(to_u, to_v[:, None]) / camera.scale_px
    _, r, z = mirror.ray_from_radius_ratio(ratio)
    return r[:, columns][rows], z[:, columns][rows]


def pixel_from_point(camera: OmniCamera, point: Floats) -> tuple[Floats, Bools]:
    """Pixel of a point in the mirror frame, and whether the camera shows it.

    Args:
        camera: the camera model.
        point: (..., 3) in the mirror frame, metres.

    Returns:
        (..., 2) pixels and a (...) mask; invalid pixels are the image centre, never NaN.
    """
    point = np.asarray(point, dtype=np.float64)
    if camera.is_central:
        return pixel_from_direction(camera, point)
    mirror = _non_central(camera)
    finite = np.asarray(np.isfinite(point).all(axis=-1))
    known = np.where(np.expand_dims(finite, -1), point, (0.0, 0.0, 1.0))
    rho, height = hypot(known[..., 0], known[..., 1]), known[..., 2]
    low = np.zeros_like(rho)
    rim_t = np.array(camera.rim_t)
    high = np.full_like(rho, float(mirror.radius_ratio_from_t(rim_t)))
    inside = (
        finite
        & (_turn(mirror, high, rho, height) >= 0.0)
        & (_turn(mirror, low, rho, height) <= 0.0)
    )
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        is_before = _turn(mirror, middle, rho, height) < 0.0
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    middle = 0.5 * (low + high)
    # From a point behind the mirror the turn jumps where others have their root.
    inside &= np.abs(_turn(mirror, middle, rho, height)) < _MAX_TURN_RAD
    t = np.minimum(mirror.ray_from_radius_ratio(middle)[0], camera.rim_t)
    # The direction at infinity with this image radius, in the point's azimuth.
    sine, cosine = 2.0 * t / (1.0 + t * t), (1.0 - t) * (1.0 + t) / (1.0 + t * t)
    across = sine / np.where(rho > 0.0, rho, 1.0)
    direction = np.stack((across * known[..., 0], across * known[..., 1], cosine), axis=-1)
    pixel, shown = pixel_from_direction(camera, direction)
    # A cone shows a circle of directions at its axis: no pixel of a point there.
    valid = np.asarray(inside & shown & ((rho > 0.0) | (mirror.t_min == 0.0)))
    return np.where(np.expand_dims(valid, -1), pixel, camera.centre_px), valid


def max_miss_m(camera: OmniCamera) -> float:
    """Largest distance at which a ray passes the effective viewpoint, metres; 0 if they meet."""
    mirror = camera.projection
    if not isinstance(mirror, NonCentralMirror):
        return 0.0
    theta = np.linspace(2.0 * arctan(mirror.t_min), camera.rim_rad, _NUM_RINGS)
    return float(mirror.largest_miss_m(tan(0.5 * theta)).max())


def near_limit_m(camera: OmniCamera, error_px: float = CENTRAL_ERROR_PX) -> float:
    """Distance beyond which the central approximation errs by at most `error_px`.

    To first order the error is the ray's miss of the viewpoint, as an angle at the scene's
    distance, times pixels per radian.
    """
    mirror = camera.projection
    if not isinstance(mirror, NonCentralMirror):
        return 0.0
    theta = np.linspace(2.0 * arctan(mirror.t_min), camera.rim_rad, _NUM_RINGS)[1:]
    t = tan(0.5 * theta)
    radial_px = camera.max_stretch * camera.radius_slope_px(t)
    return float((radial_px * mirror.largest_miss_m(t)).max()) / error_px


def _turn(mirror: NonCentralMirror, ratio: Floats, rho: Floats, height: Floats) -> Floats:
    """Angle by which a ray has turned past a point, radians: negative below, 0 through it.

    The direction from the mirror to a point before it is never straight down, so its angle has no
    jump along the mirror, whatever the rim's.
    """
    t, r, z = mirror.ray_from_radius_ratio(ratio)
    turned: Floats = 2.0 * arctan(t) - arctan2(rho - r, height - z)
    return turned


def _non_central(camera: OmniCamera) -> NonCentralMirror:
    assert isinstance(camera.projection, NonCentralMirror), "a mirror without a viewpoint"
    return camera.projection
