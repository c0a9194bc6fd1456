"""Focal length of the capture camera, by the size of the mirror in the image.

Many effects need the angle psi at the pinhole, and none needs the camera model for that: the lens
is a pinhole with tan(psi) = r / f, whatever the mirror.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera


def inverse_focal_length(camera: OmniCamera) -> float:
    """Return 1 / f of the capture camera, 1/px; 0 if orthographic.

    Equivalent: tan(psi) of an image radius of 1 px. The inverse, since f itself is infinite for an
    orthographic camera.
    """
    pinhole_m = camera.mirror.pinhole_distance_m
    if math.isinf(pinhole_m):
        return 0.0
    # From the rim, whose position on the mirror and whose image radius are both known exactly.
    r, z = camera.mirror.surface_point(np.array(camera.rim_t))
    return float(r) / (pinhole_m - float(z)) / camera.rim_radius_px
