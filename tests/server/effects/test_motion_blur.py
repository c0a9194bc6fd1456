"""A point's spread is read off pictures of coordinates: cubics and the times keep its variance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera import pixel_centres
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.capture import Capture, Geometry
from catoptra_server.effects.image_law import INNER, image_law
from catoptra_server.effects.motion_blur import MotionBlur, sample_times
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.scene.motion import AT_REST, Twist
from helpers.effects import CAMERA, CAPTURE, card
from helpers.worlds import omni_camera

BLUR = MotionBlur(1.0 / 30.0)
SHAPE = (CAMERA.height_px, CAMERA.width_px)
INSIDE = image_law(CAMERA).standing[..., 0] == INNER
THRESHOLD_PX = 0.5


def capture(twist: Twist, range_m: float = 1.0) -> Capture:
    geometry = Geometry(np.full(SHAPE, range_m, np.float32), np.zeros(SHAPE, np.float32))
    return Capture(motion=(twist,), geometry=geometry)


def spread_px(blur: MotionBlur, seen: Capture) -> Floats:
    """Return (h, w) how wide a point is spread: of an even spread of this variance.

    Where the ways stay on the mirror: the rim keeps its light.
    """
    off = pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px
    zero = np.zeros(SHAPE)
    shift = 1000.0  # light is not negative
    mean = blur.apply(np.stack((*np.moveaxis(off, -1, 0), zero), axis=-1) + shift, CAMERA, seen)
    mean = mean - shift
    square = blur.apply(np.stack((*np.moveaxis(off**2, -1, 0), zero), axis=-1), CAMERA, seen)
    variance = (square - mean**2).sum(axis=-1)
    near_rim = np.linalg.norm(off, axis=-1) > CAMERA.rim_radius_px - 10.0
    return np.where(near_rim, 0.0, np.sqrt(12.0 * np.maximum(variance, 0.0)))


@pytest.mark.parametrize("count", [2, 3, 7, 64])
def test_times_when_listed_have_mean_and_variance_of_the_exposure(count: int) -> None:
    times = np.array(sample_times(count, 0.03))
    assert len(times) == count
    assert times.mean() == pytest.approx(0.0, abs=1e-18)
    assert times.var() == pytest.approx(0.03**2 / 12.0)


@pytest.mark.parametrize("speed_m_s", [0.3, 1.0, 3.0])
def test_point_when_something_passes_is_spread_by_its_way(speed_m_s: float) -> None:
    twist = Twist((0.0, speed_m_s, 0.0))
    law = image_law(CAMERA)
    way = speed_m_s * BLUR.exposure_s * np.hypot(law.to_u[..., 1], law.to_v[..., 1])
    seen = spread_px(BLUR, capture(twist))
    inner = (seen > 0.0) & (way > 0.1)
    # Ways differ from pixel to pixel, flow is that of the nearest.
    np.testing.assert_allclose(seen[inner], way[inner], rtol=0.03)


@pytest.mark.parametrize("speed_m_s", [0.02, 0.1, 0.13, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("turn_deg_s", [0.0, 2.0, 10.0, 60.0])
@pytest.mark.parametrize("range_m", [0.4, 2.0])
def test_criterion_when_a_robot_moves_is_a_bound_and_calls_for_what_is_seen(
    speed_m_s: float, turn_deg_s: float, range_m: float
) -> None:
    twist = Twist((speed_m_s, 0.0, 0.0), (0.0, 0.0, math.radians(turn_deg_s)))
    bound = BLUR.bound(SceneSummary(1.0, (range_m,) * RINGS, motion=twist), CAMERA)
    spread = float(spread_px(BLUR, capture(twist, range_m)).max())
    assert spread <= bound.value * (1.0 + 1e-6)
    if bound.value > THRESHOLD_PX:
        assert spread > 0.5 * THRESHOLD_PX
        assert bound.reason


def test_grid_of_motions_has_both_sides_of_the_threshold() -> None:
    bounds = [
        BLUR.bound(
            SceneSummary(1.0, (range_m,) * RINGS, motion=Twist((speed, 0.0, 0.0))), CAMERA
        ).value
        for speed in (0.02, 0.1, 0.13, 0.2, 0.5, 2.0)
        for range_m in (0.4, 2.0)
    ]
    assert min(bounds) < 0.1 < THRESHOLD_PX < 2.0 < max(bounds)
    assert any(0.4 < bound <= THRESHOLD_PX for bound in bounds)


def test_picture_when_nothing_moves_keeps_its_bytes() -> None:
    light = card().astype(np.float32)
    assert BLUR.apply(light, CAMERA, capture(AT_REST)).tobytes() == light.tobytes()
    assert BLUR.bound(SceneSummary(1.0, (0.1,) * RINGS), CAMERA).value == 0.0


def test_mirror_when_of_one_light_stays_it() -> None:
    light = np.where(image_law(CAMERA).standing > 1, 0.6, 0.0) * np.ones(3)
    np.testing.assert_allclose(BLUR.apply(light, CAMERA, CAPTURE), light, rtol=1e-14)


def test_light_when_nothing_leaves_the_picture_is_conserved() -> None:
    off = np.linalg.norm(pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px, axis=-1)
    away = (off < CAMERA.rim_radius_px - 12.0)[..., None]
    light = 0.2 * INSIDE[..., None] + away * np.random.default_rng(3).uniform(0.0, 1.0, (*SHAPE, 3))
    turn = Twist(angular_rad_s=(0.0, 0.0, math.radians(100.0)))
    for twist in (turn, Twist((0.0, 0.6, 0.0)), Twist((0.0, 0.6, 0.0), turn.angular_rad_s)):
        # A way along which scales change carries more to one pixel than to another.
        change = BLUR.apply(light, CAMERA, capture(twist)).sum() / light.sum() - 1.0
        assert abs(change) < 2e-3


def test_point_when_the_scene_turns_is_spread_evenly_along_its_arc() -> None:
    light = np.zeros((*SHAPE, 3))
    row, column = 48, 78
    light[row, column] = 1.0
    turn = Twist(angular_rad_s=(0.0, 0.0, math.radians(600.0)))
    spread = BLUR.apply(light, CAMERA, capture(turn))[..., 1]
    lit = spread > 0.1 * spread.max()
    off = pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px
    radius = np.linalg.norm(off, axis=-1)
    expected_px = float(radius[row, column]) * math.radians(20.0)
    assert np.abs(radius[lit] - radius[row, column]).max() < 2.0
    assert lit.any(axis=1).sum() == pytest.approx(expected_px, abs=3.0)
    assert spread.sum() == pytest.approx(1.0, abs=0.1)


def test_bodies_when_they_pass_are_spread_alone() -> None:
    seen = replace(CAPTURE, motion=(AT_REST, CAPTURE.motion[1]))
    light = card()
    changed = np.abs(BLUR.apply(light, CAMERA, seen) - light).max(axis=-1) > 1e-6
    assert changed[42:58, 52:78].mean() > 0.7
    assert not changed[:28].any()
    assert not changed[72:].any()


def test_picture_when_blurred_is_never_negative() -> None:
    light = np.zeros((*SHAPE, 3))
    light[::7, ::5] = 3.0
    assert BLUR.apply(light, CAMERA, CAPTURE).min() == 0.0


def test_larger_picture_when_criterion_is_asked_has_a_larger_bound() -> None:
    summary = SceneSummary(1.0, (1.0,) * RINGS, motion=Twist((0.5, 0.0, 0.0)))
    small, large = (BLUR.bound(summary, omni_camera(width_px=width)).value for width in (96, 192))
    assert large == pytest.approx(2.0 * small, rel=1e-6)
