from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera import pixel_centres
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.capture import Capture, Geometry
from catoptra_server.effects.image_law import image_law
from catoptra_server.effects.rolling_shutter import RollingShutter, row_times
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.scene.motion import AT_REST, Twist
from helpers.effects import CAMERA, CAPTURE, card
from helpers.worlds import omni_camera

SHUTTER = RollingShutter(1.0 / 30.0)
SHAPE = (CAMERA.height_px, CAMERA.width_px)
THRESHOLD_PX = 0.5


def capture(twist: Twist, range_m: float = 1.0) -> Capture:
    geometry = Geometry(np.full(SHAPE, range_m, np.float32), np.zeros(SHAPE, np.float32))
    return Capture(motion=(twist,), geometry=geometry)


def carried_px(shutter: RollingShutter, seen: Capture) -> Floats:
    """Return (2, h, w) px from each pixel to where its light comes from; 0 next to the rim."""
    place = pixel_centres(CAMERA)[..., 0, :]
    ramps = np.concatenate((place, np.ones((*SHAPE, 1))), axis=-1)
    off = np.linalg.norm(place - CAMERA.centre_px, axis=-1)
    aside = (shutter.apply(ramps, CAMERA, seen) - ramps)[..., :2]
    return np.moveaxis(np.where((off < CAMERA.rim_radius_px - 6.0)[..., None], aside, 0.0), -1, 0)


def test_rows_when_read_are_centred_on_the_pose() -> None:
    times = row_times(replace(CAMERA, height_px=4), 0.04)
    np.testing.assert_allclose(times, [-0.015, -0.005, 0.005, 0.015])


def test_picture_when_the_camera_turns_is_sheared_by_its_arc() -> None:
    rate = math.radians(60.0)
    aside = carried_px(SHUTTER, capture(Twist(angular_rad_s=(0.0, 0.0, rate))))
    off = np.moveaxis(pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px, -1, 0)
    law = image_law(CAMERA)
    tau = row_times(CAMERA, SHUTTER.readout_s)[:, None]
    straight = -rate * tau * np.stack((law.about_u[..., 2], law.about_v[..., 2]))
    seen = np.hypot(*aside) > 0.0
    # Half of the angle's square times the radius: the arc's depth.
    assert np.abs(aside - straight)[:, seen].max() < 0.5 * (rate * 1.0 / 60.0) ** 2 * 48.0 + 1e-3
    assert np.hypot(*aside).max() > 0.4
    np.testing.assert_allclose(
        np.linalg.norm(off + aside, axis=0)[seen], np.linalg.norm(off, axis=0)[seen], atol=0.01
    )


@pytest.mark.parametrize("speed_m_s", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 10.0, 60.0, 150.0])
@pytest.mark.parametrize("range_m", [0.3, 1.5])
def test_criterion_when_a_robot_moves_is_a_bound_and_calls_for_what_is_seen(
    speed_m_s: float, turn_deg_s: float, range_m: float
) -> None:
    twist = Twist((0.0, speed_m_s, 0.0), (0.0, 0.0, math.radians(turn_deg_s)))
    bound = SHUTTER.bound(SceneSummary(1.0, (range_m,) * RINGS, motion=twist), CAMERA)
    carried = float(np.hypot(*carried_px(SHUTTER, capture(twist, range_m))).max())
    assert carried <= bound.value * (1.0 + 1e-6)
    if bound.value > THRESHOLD_PX:
        assert carried > 0.5 * THRESHOLD_PX
        assert bound.reason


def test_wide_picture_when_criterion_is_asked_counts_the_rows_of_the_mirror() -> None:
    turn = SceneSummary(1.0, motion=Twist(angular_rad_s=(0.0, 0.0, 1.0)))
    tall = replace(CAMERA, height_px=192, centre_px=(48.0, 96.0))
    aside = replace(CAMERA, height_px=192, centre_px=(48.0, 48.0))
    full = SHUTTER.bound(turn, CAMERA).value
    assert SHUTTER.bound(turn, tall).value == pytest.approx(0.5 * full)
    assert SHUTTER.bound(turn, aside).value == pytest.approx(full)


def test_global_shutter_when_criterion_is_asked_is_left_out_and_changes_nothing() -> None:
    ccd, light = RollingShutter(0.0), card().astype(np.float32)
    fast = SceneSummary(1.0, (0.1,) * RINGS, motion=Twist((9.0, 0.0, 0.0)))
    assert ccd.bound(fast, CAMERA).value == 0.0
    assert ccd.bound(fast, CAMERA).reason == "a global shutter"
    assert ccd.apply(light, CAMERA, CAPTURE).tobytes() == light.tobytes()


def test_picture_when_nothing_moves_keeps_its_bytes() -> None:
    light = card().astype(np.float32)
    assert SHUTTER.apply(light, CAMERA, capture(AT_REST)).tobytes() == light.tobytes()


def test_mirror_when_of_one_light_stays_it() -> None:
    light = np.where(image_law(CAMERA).standing > 1, 0.6, 0.0) * np.ones(3)
    np.testing.assert_allclose(SHUTTER.apply(light, CAMERA, CAPTURE), light, rtol=1e-14)


def test_larger_picture_when_criterion_is_asked_has_a_larger_bound() -> None:
    summary = SceneSummary(1.0, (1.0,) * RINGS, motion=Twist((0.5, 0.0, 0.0)))
    small, large = (
        SHUTTER.bound(summary, omni_camera(width_px=width)).value for width in (96, 192)
    )
    assert large == pytest.approx(2.0 * small, rel=1e-6)
