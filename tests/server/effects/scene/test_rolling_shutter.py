"""Bound of a rolling shutter against the displacement by the camera model until each exposure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import NUM_RINGS, SceneSummary
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.world.world_description import Twist
from helpers.effect_measurement import CAMERA
from helpers.motion_reference import displacements_px

SHUTTER = RollingShutter(1.0 / 30.0)
THRESHOLD_PX = 0.5


def max_displacement_px(twist: Twist, range_m: float) -> float:
    """Largest displacement of a pixel by the camera model, px."""
    rows = (np.arange(CAMERA.height_px) + 0.5) / CAMERA.height_px - 0.5
    ways = displacements_px(CAMERA, twist, np.array(range_m), (SHUTTER.readout_s * rows)[:, None])
    return float(np.nanmax(np.linalg.norm(ways, axis=-1)))


@pytest.mark.parametrize("speed_m_s", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 10.0, 60.0, 150.0])
@pytest.mark.parametrize("range_m", [0.3, 1.5])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)], ids=["yaw", "pitch"])
def test_criterion_when_a_robot_moves_is_a_bound_and_enables_visible_motion(
    speed_m_s: float, turn_deg_s: float, range_m: float, axis: tuple[float, float, float]
) -> None:
    twist = Twist((0.0, speed_m_s, 0.0), (*(math.radians(turn_deg_s) * np.array(axis)).tolist(),))
    bound = SHUTTER.bound(SceneSummary(1.0, (range_m,) * NUM_RINGS, scene_twist=twist), CAMERA)
    carried = max_displacement_px(twist, range_m)
    # Displacement exceeds speed times duration, since the speed changes.
    assert carried <= bound.displacement_px * 1.02
    if bound.displacement_px > THRESHOLD_PX:
        assert carried > 0.5 * THRESHOLD_PX
        assert bound.reason


def test_wide_image_counts_the_rows_of_the_mirror() -> None:
    turn = SceneSummary(1.0, scene_twist=Twist(angular_rad_s=(0.0, 0.0, 1.0)))
    tall = replace(CAMERA, height_px=192, centre_px=(48.0, 96.0))
    aside = replace(CAMERA, height_px=192, centre_px=(48.0, 48.0))
    full = SHUTTER.bound(turn, CAMERA).displacement_px
    assert SHUTTER.bound(turn, tall).displacement_px == pytest.approx(0.5 * full)
    assert SHUTTER.bound(turn, aside).displacement_px == pytest.approx(full)


def test_global_shutter_is_disabled_by_the_criterion() -> None:
    ccd = RollingShutter(0.0)
    fast = SceneSummary(1.0, (0.1,) * NUM_RINGS, scene_twist=Twist((9.0, 0.0, 0.0)))
    assert ccd.bound(fast, CAMERA).value == 0.0
    assert ccd.bound(fast, CAMERA).reason == "a global shutter"
