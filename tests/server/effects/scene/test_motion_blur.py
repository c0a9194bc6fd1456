"""Bound of motion blur against the spread of points by the camera model during an exposure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.effects import NUM_RINGS, SceneSummary
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.world.world_description import Twist
from helpers.effect_measurement import CAMERA
from helpers.motion_reference import displacements_px
from helpers.worlds import make_omni_camera

BLUR = MotionBlur(1.0 / 30.0)
THRESHOLD_PX = 0.5


def max_blur_px(twist: Twist, range_m: float) -> float:
    """Largest spread of a point by the camera model, px."""
    half = 0.5 * BLUR.exposure_s
    ways = [displacements_px(CAMERA, twist, np.array(range_m), np.array(t)) for t in (-half, half)]
    return float(np.nanmax(np.linalg.norm(ways[1] - ways[0], axis=-1)))


@pytest.mark.parametrize("speed_m_s", [0.02, 0.1, 0.13, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 2.0, 10.0, 60.0])
@pytest.mark.parametrize("range_m", [0.4, 2.0])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)], ids=["yaw", "pitch"])
def test_criterion_when_a_robot_moves_is_a_bound_and_enables_visible_motion(
    speed_m_s: float, turn_deg_s: float, range_m: float, axis: tuple[float, float, float]
) -> None:
    twist = Twist((speed_m_s, 0.0, 0.0), (*(math.radians(turn_deg_s) * np.array(axis)).tolist(),))
    bound = BLUR.bound(SceneSummary(1.0, (range_m,) * NUM_RINGS, scene_twist=twist), CAMERA)
    widest = max_blur_px(twist, range_m)
    # Displacement exceeds speed times duration, since the speed changes: by 1e-3 at 2 m/s.
    assert widest <= bound.displacement_px * 1.01
    if bound.displacement_px > THRESHOLD_PX:
        # Slowest where a bound adds a turn and a drive that act in different directions.
        assert widest > 0.45 * THRESHOLD_PX
        assert bound.reason


def test_grid_of_motions_has_both_sides_of_the_threshold() -> None:
    bounds = [
        BLUR.bound(
            SceneSummary(1.0, (range_m,) * NUM_RINGS, scene_twist=Twist((speed, 0.0, 0.0))), CAMERA
        ).displacement_px
        for speed in (0.02, 0.1, 0.13, 0.2, 0.5, 2.0)
        for range_m in (0.4, 2.0)
    ]
    assert min(bounds) < 0.1 < THRESHOLD_PX < 2.0 < max(bounds)
    assert any(0.4 < bound <= THRESHOLD_PX for bound in bounds)


def test_robot_when_it_stands_is_not_blurred() -> None:
    assert BLUR.bound(SceneSummary(1.0, (0.1,) * NUM_RINGS), CAMERA).value == 0.0


def test_larger_image_has_a_larger_bound() -> None:
    summary = SceneSummary(1.0, (1.0,) * NUM_RINGS, scene_twist=Twist((0.5, 0.0, 0.0)))
    small, large = (
        BLUR.bound(summary, make_omni_camera(width_px=width)).displacement_px for width in (96, 192)
    )
    assert large == pytest.approx(2.0 * small, rel=1e-6)
