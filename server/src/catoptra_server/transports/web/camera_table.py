"""The model of an omnidirectional camera as a table, so that the page needs no formula of a mirror.

A direction with incidence angle theta and azimuth phi has the pixel
centre + r(theta) * [[a, b], [c, d]] @ [cos phi, sin phi]; r is interpolated between table entries.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction

# Interpolated linearly, 4096 entries miss 3e-5 px at 640 px and a rim of 120 degrees.
NUM_ENTRIES = 4096


def camera_table(camera: OmniCamera) -> dict[str, object]:
    """Table of a camera as a JSON object; pixels and radians."""
    theta_rad = np.linspace(0.0, camera.rim_rad, NUM_ENTRIES)
    # A cone shows nothing nearer to its axis than its apex does.
    lowest_t = camera.projection.t_min
    ratio = camera.projection.radius_ratio_from_t(np.maximum(np.tan(0.5 * theta_rad), lowest_t))
    # The image of the x axis and of the y axis, read from the model itself, over its radius: the
    # stretch of a calibrated image plane is in the matrix, its decentring of a pixel or two is not.
    middle_rad = 0.5 * (2.0 * math.atan(lowest_t) + camera.rim_rad)
    sine, cosine = math.sin(middle_rad), math.cos(middle_rad)
    directions = np.array([[sine, 0.0, cosine], [0.0, sine, cosine]])
    pixels, _ = pixel_from_direction(camera, directions)
    radius_px = float(camera.radius_px_from_t(np.array(math.tan(0.5 * middle_rad))))
    (a, c), (b, d) = (pixels - camera.centre_px) / radius_px
    return {
        "kind": "radial",
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "centre_px": camera.centre_px,
        "max_theta_rad": camera.rim_rad,
        "azimuth_matrix": [float(a), float(b), float(c), float(d)],
        "radius_px": (camera.scale_px * ratio).tolist(),
    }
