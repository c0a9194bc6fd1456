from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.effects.kernels.focal_length import inverse_focal_length
from helpers.effect_measurement import CAMERA
from helpers.worlds import make_omni_camera


def test_focal_length_gives_the_angle_of_the_ray_to_the_mirrors_point() -> None:
    # From a point of the mirror and the pinhole alone, without a focal length.
    t = np.array(0.7 * CAMERA.rim_t)
    r, z = CAMERA.mirror.surface_point(t)
    psi = math.atan2(float(r), CAMERA.mirror.pinhole_distance_m - float(z))
    radius_px = CAMERA.horizon_radius_px * float(CAMERA.mirror.radius_ratio_from_t(t))
    assert math.atan(radius_px * inverse_focal_length(CAMERA)) == pytest.approx(psi, rel=1e-12)


def test_focal_length_of_an_orthographic_camera_is_infinite() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
    assert inverse_focal_length(camera) == 0.0
