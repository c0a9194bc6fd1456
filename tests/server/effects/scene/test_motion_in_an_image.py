"""Bounds of motion blur and rolling shutter against displacements by the camera model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import NUM_RINGS, EffectBound, SceneSummary
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.world.world_description import Twist
from helpers.effect_measurement import CAMERA
from helpers.motion_reference import displacements_px
from helpers.worlds import make_omni_camera

BLUR, SHUTTER = MotionBlur(1.0 / 30.0), RollingShutter(1.0 / 30.0)
THRESHOLD_PX = 0.5
# Displacements at the begin and the end of an exposure, and of each row at its own time.
ENDS_S = 0.5 * BLUR.exposure_s * np.array((-1.0, 1.0))[:, None, None]
ROWS_S = SHUTTER.readout_s * ((np.arange(CAMERA.height_px) + 0.5) / CAMERA.height_px - 0.5)


def summarize(twist: Twist, range_m: float = math.inf) -> SceneSummary:
    return SceneSummary(1.0, (range_m,) * NUM_RINGS, scene_twist=twist)


def assert_bounds(bound: EffectBound, displacements: Floats, *, excess: float) -> None:
    """Assert that displacements, px, are within a bound, and visible where it enables an effect.

    A displacement exceeds speed times duration by a fraction, since the speed changes.
    """
    largest_px = float(np.nanmax(np.linalg.norm(displacements, axis=-1)))
    assert bound.displacement_px is not None
    assert largest_px <= bound.displacement_px * (1.0 + excess)
    if bound.displacement_px > THRESHOLD_PX:
        assert largest_px > 0.5 * THRESHOLD_PX
        assert bound.reason


@pytest.mark.parametrize("speed_m_s", [0.02, 0.1, 0.13, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 2.0, 10.0, 60.0])
@pytest.mark.parametrize("range_m", [0.4, 2.0])
def test_criterion_of_blur_is_a_bound_and_enables_visible_motion(
    speed_m_s: float, turn_deg_s: float, range_m: float
) -> None:
    twist = Twist((speed_m_s, 0.0, 0.0), (0.0, 0.0, math.radians(turn_deg_s)))
    ends = [displacements_px(CAMERA, twist, np.array(range_m), time_s) for time_s in ENDS_S]
    assert_bounds(BLUR.bound(summarize(twist, range_m), CAMERA), ends[1] - ends[0], excess=0.01)


@pytest.mark.parametrize("speed_m_s", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 10.0, 60.0, 150.0])
@pytest.mark.parametrize("range_m", [0.3, 1.5])
def test_criterion_of_a_rolling_shutter_is_a_bound_and_enables_visible_motion(
    speed_m_s: float, turn_deg_s: float, range_m: float
) -> None:
    twist = Twist((0.0, speed_m_s, 0.0), (0.0, 0.0, math.radians(turn_deg_s)))
    rows = displacements_px(CAMERA, twist, np.array(range_m), ROWS_S[:, None])
    assert_bounds(SHUTTER.bound(summarize(twist, range_m), CAMERA), rows, excess=0.02)


def test_grid_of_motions_has_both_sides_of_the_threshold() -> None:
    bounds = [
        BLUR.bound(summarize(Twist((speed, 0.0, 0.0)), range_m), CAMERA).displacement_px
        for speed in (0.02, 0.1, 0.13, 0.2, 0.5, 2.0)
        for range_m in (0.4, 2.0)
    ]
    assert min(bounds) < 0.1 < THRESHOLD_PX < 2.0 < max(bounds)
    assert any(0.4 < bound <= THRESHOLD_PX for bound in bounds)


def test_robot_when_it_stands_is_not_blurred() -> None:
    assert BLUR.bound(SceneSummary(1.0, (0.1,) * NUM_RINGS), CAMERA).value == 0.0


def test_larger_image_has_a_larger_bound() -> None:
    summary = summarize(Twist((0.5, 0.0, 0.0)), 1.0)
    small, large = (
        BLUR.bound(summary, make_omni_camera(width_px=width)).displacement_px for width in (96, 192)
    )
    assert large == pytest.approx(2.0 * small, rel=1e-6)


def test_wide_image_counts_the_rows_of_the_mirror() -> None:
    turn = summarize(Twist(angular_rad_s=(0.0, 0.0, 1.0)))
    tall = replace(CAMERA, height_px=192, centre_px=(48.0, 96.0))
    aside = replace(CAMERA, height_px=192, centre_px=(48.0, 48.0))
    full = SHUTTER.bound(turn, CAMERA).displacement_px
    assert SHUTTER.bound(turn, tall).displacement_px == pytest.approx(0.5 * full)
    assert SHUTTER.bound(turn, aside).displacement_px == pytest.approx(full)


def test_global_shutter_is_disabled_by_the_criterion() -> None:
    bound = RollingShutter(0.0).bound(summarize(Twist((9.0, 0.0, 0.0)), 0.1), CAMERA)
    assert (bound.value, bound.reason) == (0.0, "a global shutter")
