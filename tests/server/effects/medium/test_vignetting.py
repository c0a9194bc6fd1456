from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.effects.medium.vignetting import Vignetting, vignetting_map
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
)
from helpers.worlds import make_omni_camera


def test_white_when_darkened_loses_13_linear_levels_at_the_papers_rim() -> None:
    tangent = CAMERA.rim_radius_px * CAMERA.inverse_focal_length
    # A mirror of 85 mm at twice 0.2321 m: 13.4 of 255.
    assert 255.0 * (1.0 - math.cos(math.atan(tangent)) ** 4) == pytest.approx(13.4, abs=0.06)


def test_axis_when_a_pixel_is_there_keeps_its_light() -> None:
    camera = make_omni_camera(width_px=97)
    assert vignetting_map(camera)[48, 48, 0] == 1.0
    image = np.ones((97, 97, 3))
    np.testing.assert_array_equal(Vignetting().apply(image, camera, CAPTURE_CONTEXT)[48, 48], 1.0)


def test_orthographic_camera_has_no_vignetting() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
    assert_effect_negligible(Vignetting(), camera=camera)


def test_narrow_rim_is_disabled_by_the_criterion() -> None:
    assert_effect_negligible(Vignetting(), camera=make_omni_camera(width_px=96, rim_deg=28.0))


def test_papers_rim_is_enabled_by_the_criterion() -> None:
    assert_effect_not_negligible(Vignetting())
