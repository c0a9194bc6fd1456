from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import (
    NUM_RINGS,
    CaptureContext,
    EffectMode,
    EffectSetting,
    EffectSettings,
    SceneSummary,
)
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    CircleOfConfusion,
    circle_of_confusion_map,
)
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.world.world_description import srgb_from_linear
from helpers.blur_measurement import inner_pixels, measure_blur_diameters_px
from helpers.effect_measurement import CAPTURE_CONTEXT
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=160)
PITCH_M = 7.4e-6 * 360.0 / 160.0
SHAPE = (CAMERA.height_px, CAMERA.width_px)


def make_both(f_number: float, focus_m: float = 0.0) -> tuple[DefocusByDepth, Defocus]:
    aperture = Aperture(f_number, PITCH_M, focus_m)
    return DefocusByDepth(aperture), Defocus(aperture)


def context_at_range(range_m: float) -> CaptureContext:
    everywhere = np.full(SHAPE, range_m, dtype=np.float32)
    return replace(CAPTURE_CONTEXT, range_m=everywhere)


def diameter_change_px(effects: tuple[DefocusByDepth, Defocus], range_m: float) -> float:
    """Largest difference between discs at a range and those at infinity, px."""
    by_depth, fixed = effects
    capture = context_at_range(range_m)
    near = measure_blur_diameters_px(by_depth, CAMERA, capture)
    return float(np.abs(near - measure_blur_diameters_px(fixed, CAMERA, CAPTURE_CONTEXT)).max())


GRID = [
    (f_number, focus_m, nearest_m)
    for f_number in (1.0, 2.0, 4.0)
    for focus_m in (0.0, 0.4)
    for nearest_m in (0.12, 0.25, 0.6, 2.0)
]


@pytest.mark.parametrize(("f_number", "focus_m", "nearest_m"), GRID)
def test_bound_when_discs_are_measured_holds_and_is_reached(
    f_number: float, focus_m: float, nearest_m: float
) -> None:
    effects = make_both(f_number, focus_m)
    bound = effects[0].bound(SceneSummary(1.0, min_distances_m=(nearest_m,) * NUM_RINGS), CAMERA)
    measured = [diameter_change_px(effects, nearest_m * factor) for factor in (1.0, 1.3, 2.0, 5.0)]
    # Rounding of float32 ranges.
    assert max(measured) <= bound.displacement_px + 1e-4
    is_wide = bound.displacement_px > 0.5
    assert not is_wide or max(measured) > max(0.25, 0.8 * bound.displacement_px)


def test_grid_when_decided_has_both_sides() -> None:
    bounds = [
        make_both(f_number, focus_m)[0]
        .bound(SceneSummary(1.0, min_distances_m=(nearest_m,) * NUM_RINGS), CAMERA)
        .displacement_px
        for f_number, focus_m, nearest_m in GRID
    ]
    assert sum(bound > 0.5 for bound in bounds) > 4
    assert sum(bound <= 0.5 for bound in bounds) > 4


def test_disc_when_measured_is_that_of_the_pixels_range() -> None:
    effect = make_both(2.0)[0]
    range_m = np.linspace(0.1, 1.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE).astype(np.float32)
    capture = replace(CAPTURE_CONTEXT, range_m=range_m)
    inner = inner_pixels(CAMERA, 5.0)
    expected = circle_of_confusion_map(effect.aperture, CAMERA).diameter_px(
        range_m.astype(np.float64)
    )
    measured = measure_blur_diameters_px(effect, CAMERA, capture)
    np.testing.assert_allclose(measured[inner], expected[inner], atol=2e-5)


def test_image_when_nothing_is_near_is_that_of_the_fixed_part() -> None:
    by_depth, fixed = make_both(2.0)
    image = np.random.default_rng(2).uniform(0.0, 1.0, (*SHAPE, 3))
    far = by_depth.apply(image, CAMERA, context_at_range(np.inf))
    np.testing.assert_allclose(far, fixed.apply(image, CAMERA, CAPTURE_CONTEXT), atol=1e-12)


@pytest.mark.parametrize(
    ("fixed_px", "near_px", "expected"),
    [
        (2.0, 0.5, 0.5),  # before the focus: discs only grow
        (-2.0, 0.5, 0.5),  # behind the focus: discs shrink
        (-0.4, 0.5, 0.4),  # to a point and grow again
        (-0.4, 2.0, 1.2),  # beyond the diameter at infinity
    ],
)
def test_change_when_the_focus_is_passed_counts_what_lies_between(
    fixed_px: float, near_px: float, expected: float
) -> None:
    circle = CircleOfConfusion(*(np.array(value) for value in (fixed_px, near_px, 1.0, 0.0)))
    assert circle.max_diameter_change_px(np.array(1.0)) == pytest.approx(expected)


@pytest.mark.parametrize("fixed_mode", [EffectMode.AUTO, EffectMode.ALWAYS])
@pytest.mark.parametrize(("nearest_m", "runs"), [(0.12, "DefocusByDepth"), (math.inf, "Defocus")])
def test_light_is_blurred_once_by_the_one_that_the_scene_enables(
    nearest_m: float, runs: str, fixed_mode: EffectMode
) -> None:
    by_depth, fixed = make_both(2.0)
    settings = EffectSettings(
        (EffectSetting(by_depth, EffectMode.AUTO), EffectSetting(fixed, fixed_mode))
    )
    plan = plan_effects(
        settings, SceneSummary(1.0, min_distances_m=(nearest_m,) * NUM_RINGS), CAMERA
    )
    assert [effect.name for effect in plan.image_effects] == [runs]


def test_fixed_part_when_it_is_disabled_leaves_no_depth_to_be_enabled() -> None:
    for f_number in (1.0, 4.0, 6.0, 8.0, 16.0):
        for nearest_m in (0.08, 0.2, 1.0):
            summary = SceneSummary(1.0, min_distances_m=(nearest_m,) * NUM_RINGS)
            by_depth, fixed = (each.bound(summary, CAMERA).value for each in make_both(f_number))
            assert by_depth <= fixed


@pytest.mark.parametrize(("f_number", "focus_m", "nearest_m"), GRID)
def test_bound_in_grey_levels_is_that_of_the_difference_to_infinity(
    f_number: float, focus_m: float, nearest_m: float
) -> None:
    by_depth, fixed = make_both(f_number, focus_m)
    bound = by_depth.bound(SceneSummary(1.0, min_distances_m=(nearest_m,) * NUM_RINGS), CAMERA)
    image = np.random.default_rng(4).integers(0, 2, (*SHAPE, 3)).astype(np.float64)
    far = srgb_from_linear(fixed.apply(image, CAMERA, CAPTURE_CONTEXT))
    for factor in (1.0, 1.5, 4.0):
        near = by_depth.apply(image, CAMERA, context_at_range(factor * nearest_m))
        change = 255.0 * float(np.abs(srgb_from_linear(near) - far).max())
        assert change <= bound.value + 1e-3
