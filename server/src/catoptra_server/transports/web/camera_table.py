"""The model of an omnidirectional camera as tables, so that the page needs no formula of a mirror.

A direction with incidence angle theta and azimuth phi, (x, y) = (cos phi, sin phi), has the pixel

    centre + r(theta) * [[a, b], [c, d]] @ [x, y] + q(theta) * [[e, f, g], [h, i, j]] @ [xx, xy, yy]

r and q are interpolated between table entries. The second term is the tangential distortion of a
decentred lens, of second order in the azimuth; other cameras have none. Of a mirror without a
single viewpoint theta is that of things far away, and the ray begins on the mirror's surface.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from catoptra_protocol.optics.image_plane import DistortedProjection
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction

# Interpolated linearly, 4096 entries miss 3e-5 px at 640 px and a rim of 120 degrees.
NUM_ENTRIES = 4096
_DIAGONAL = math.sqrt(0.5)


def camera_table(camera: OmniCamera) -> dict[str, object]:
    """Table of a camera as a JSON object; pixels and radians."""
    # A cone shows nothing nearer to its axis than its apex does.
    lowest_t = camera.projection.t_min
    theta_rad = np.linspace(0.0, camera.rim_rad, NUM_ENTRIES)
    t = np.maximum(np.tan(0.5 * theta_rad), lowest_t)
    # The matrices are read from the model itself, hand and stretch included, at one angle.
    middle_t = math.tan(0.25 * (2.0 * math.atan(lowest_t) + camera.rim_rad))
    odd, even = _offsets(camera, middle_t)
    azimuth_matrix = odd[:2].T / float(camera.radius_px_from_t(np.array(middle_t)))
    return {
        "kind": "radial",
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "centre_px": camera.centre_px,
        "picture": camera.picture.value,
        "min_theta_rad": 2.0 * math.atan(lowest_t),
        "max_theta_rad": camera.rim_rad,
        "azimuth_matrix": azimuth_matrix.ravel().tolist(),
        "radius_px": camera.radius_px_from_t(t).tolist(),
        **_decentring(camera, t, middle_t, even),
        **_surface(camera, t),
    }


def _offsets(camera: OmniCamera, t: float) -> tuple[Floats, Floats]:
    """Offsets (3, 2) from the centre along x, y and their diagonal: odd and even in the azimuth."""
    sine, cosine = 2.0 * t / (1.0 + t * t), (1.0 - t * t) / (1.0 + t * t)
    level = sine * np.array([(1.0, 0.0), (0.0, 1.0), (_DIAGONAL, _DIAGONAL)])
    directions = [np.column_stack((sign * level, np.full(3, cosine))) for sign in (1.0, -1.0)]
    pixels, _ = pixel_from_direction(camera, np.array(directions))
    ahead, behind = pixels - camera.centre_px
    return 0.5 * (ahead - behind), 0.5 * (ahead + behind)


def _decentring(camera: OmniCamera, t: Floats, middle_t: float, even: Floats) -> dict[str, object]:
    """The term of a decentred lens; nothing for others."""
    if not camera.plane.is_decentred:
        return {}
    projection = cast(DistortedProjection, camera.projection)

    def squared_px(t: Floats) -> Floats:
        return camera.scale_px * np.square(projection.undistorted_ratio_from_t(t))

    along_x, along_y, diagonal = even / float(squared_px(np.array(middle_t)))
    matrix = np.column_stack((along_x, 2.0 * diagonal - along_x - along_y, along_y))
    return {
        "decentring_matrix": matrix.ravel().tolist(),
        "decentring_px": squared_px(t).tolist(),
    }


def _surface(camera: OmniCamera, t: Floats) -> dict[str, object]:
    """Where the rays of a mirror without a single viewpoint begin; nothing for other cameras."""
    if camera.is_central:
        return {}
    r, z = camera.mirror.surface_point(np.minimum(t, camera.rim_t))
    return {"surface_r_m": r.tolist(), "surface_z_m": z.tolist()}
