from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import SceneSummary, Threshold
from catoptra_server.effects.kernels.grey_levels import (
    max_change_by_factors,
    mean_luminance,
    measure_change,
)
from catoptra_server.effects.sensor.auto_exposure import AutoExposure, expect_gain
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_criterion,
    make_effect,
    make_test_pattern,
)
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world

DEFAULT_AUTO_EXPOSURE = AutoExposure(0.18, 0.1, 10.0)


@pytest.mark.parametrize("largest", [0.1, 1.0, 5.0])
def test_mean_when_the_gain_suffices_is_the_target(largest: float) -> None:
    behind = DEFAULT_AUTO_EXPOSURE.apply(make_test_pattern(largest), CAMERA, CAPTURE_CONTEXT)
    assert mean_luminance(behind, CAMERA) == pytest.approx(0.18, rel=1e-12)


@pytest.mark.parametrize(("largest", "gain"), [(1e-3, 10.0), (100.0, 0.1), (0.0, 10.0)])
def test_gain_when_the_target_is_out_of_reach_stays_at_its_limit(
    largest: float, gain: float
) -> None:
    assert DEFAULT_AUTO_EXPOSURE.gain(mean_luminance(make_test_pattern(largest), CAMERA)) == gain


def test_criterion_enables_a_free_gain_and_no_pinned_one() -> None:
    assert_criterion(
        off=[(AutoExposure(0.18, 0.9995, 1.0005), 1.0)], on=[(DEFAULT_AUTO_EXPOSURE, 1.0)]
    )


WIDE = AutoExposure(0.18, 1e-3, 1e3)
ANY = Threshold(0.5, (0.0, 2e3), spill=(1e3, 0.1))
CHAIN = (make_effect("Vignetting"), Exposure(0.04, 0.02), WIDE, make_effect("Bayer"))
THRESHOLDS = {"Shadows": ANY, "Vignetting": ANY, "AutoExposure": ANY, "Bayer": ANY}


def test_thresholds_before_an_automatic_exposure_have_the_gain_of_the_light() -> None:
    # Twice as bright behind the exposure time: a gain of 0.9, with a reserve to both sides.
    found = expect_gain(THRESHOLDS, CHAIN, 0.1)
    for name in ("Shadows", "Vignetting"):
        assert found[name].gains == pytest.approx((0.0, 2.0 * 0.9 * 1.5))
        assert found[name].spill == pytest.approx((0.9 * 1.5, 0.1))
    assert found["AutoExposure"] is found["Bayer"] is ANY


@pytest.mark.parametrize(("mean", "largest"), [(1e-9, 2e3), (0.0, 2e3), (1e9, 3e-3)])
def test_thresholds_in_the_dark_or_in_glare_have_the_gain_of_a_limit(
    mean: float, largest: float
) -> None:
    assert expect_gain(THRESHOLDS, CHAIN, mean)["Shadows"].gains[1] == pytest.approx(largest)


@pytest.mark.parametrize("engine", ["kernel", "reference"])
def test_image_that_shows_nothing_of_the_mirror_is_black(engine: EngineName) -> None:
    world = make_test_world()
    beside = replace(CAMERA, centre_px=(1e4, 1e4))
    renderer = TraceRenderer(build_scene(world), world, threads=1, engine=engine)
    view = renderer.prepare(beside, make_plan(beside))
    assert not view.render(CAMERA_STATE, (WIDE,)).rgb.any()
    renderer.close()


@pytest.mark.parametrize("engine", ["kernel", "reference"])
@pytest.mark.parametrize("name", ["MirrorReflectance", "Vignetting", "Exposure"])
@pytest.mark.parametrize("control", [WIDE, AutoExposure(0.18, 0.9, 1.1)])
def test_change_by_a_factor_is_what_the_exposure_leaves_of_it(
    control: AutoExposure, name: str, engine: EngineName
) -> None:
    world = make_test_world()
    renderer = TraceRenderer(build_scene(world), world, threads=1, engine=engine)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    effect = make_effect(name, {"white_exposure_s": 1.0 / 70.0} if name == "Exposure" else None)
    effects = (effect, make_effect("MirrorDust", {"coverage": 0.0}), control)
    thresholds = {name: Threshold(0.5, control.gains)}
    change = view.render(CAMERA_STATE, effects, thresholds).changes[name].largest
    pair = [view.render_linear(CAMERA_STATE, chain) for chain in (effects, effects[1:])]
    renderer.close()
    true = measure_change(*pair).largest
    assert change == pytest.approx(true, abs=0.02)
    assert (true < 0.01) == (name == "Exposure" and control is WIDE)


def test_bound_of_factors_holds_for_a_pixel_that_the_exposure_brightens() -> None:
    # All light has the least factor, but for one pixel.
    factors = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.98)
    factors[CAMERA.height_px // 2, CAMERA.width_px // 2] = 1.02
    light = np.full_like(factors, WIDE.target_luminance)
    pair = (WIDE.apply(one, CAMERA, CAPTURE_CONTEXT) for one in (light, factors * light))
    true = measure_change(*pair).largest
    alone, exposed = (
        max_change_by_factors(0.98, 1.02, SceneSummary(0.18, exposes_itself=exposes_itself))
        for exposes_itself in (False, True)
    )
    assert alone < true <= exposed
