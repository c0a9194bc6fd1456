"""Fog by Koschmieder's law: transmitted light, airlight, and the criterion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.medium.fog import Fog, mirror_mask
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.colour import srgb_from_linear
from helpers.effect_measurement import CAMERA, THRESHOLD, make_test_pattern

SHAPE = (CAMERA.height_px, CAMERA.width_px)
GREY_FOG = Fog(0.2, 0.5, 0.5, 0.5)
ON_MIRROR = mirror_mask(CAMERA)[..., 0] > 0.0


def context_at_range(range_m: Floats | float) -> CaptureContext:
    ranges = np.broadcast_to(np.float32(range_m), SHAPE)
    return CaptureContext(range_m=ranges)


def max_grey_level_change(fog: Fog, image: Floats, context: CaptureContext) -> float:
    """Largest change of a pixel, grey levels."""
    fogged = fog.apply(image, CAMERA, context)
    return 255.0 * float(np.abs(srgb_from_linear(fogged) - srgb_from_linear(image)).max())


def test_light_when_arriving_from_afar_is_mixed_with_the_fogs() -> None:
    radiance = np.where(ON_MIRROR[..., None], (0.9, 0.1, 0.0), 0.0)
    fogged = Fog(0.5, 0.2, 0.4, 0.6).apply(radiance, CAMERA, context_at_range(2.0))
    through = math.exp(-1.0)
    expected = np.array((0.9, 0.1, 0.0)) * through + np.array((0.2, 0.4, 0.6)) * (1.0 - through)
    np.testing.assert_allclose(fogged[48, 48], expected, rtol=1e-12)


def test_white_and_black_at_the_visual_range_differ_by_5_percent() -> None:
    # Koschmieder: the visibility is ln(20) / beta.
    capture = context_at_range(math.log(20.0) / GREY_FOG.density_per_m)
    white, black = np.ones((*SHAPE, 3)), np.zeros((*SHAPE, 3))
    left = GREY_FOG.apply(white, CAMERA, capture) - GREY_FOG.apply(black, CAMERA, capture)
    np.testing.assert_allclose(left[ON_MIRROR], 0.05, rtol=1e-6)


def test_background_at_infinity_has_the_fogs_own_light() -> None:
    fogged = GREY_FOG.apply(make_test_pattern(), CAMERA, context_at_range(math.inf))
    np.testing.assert_array_equal(fogged[ON_MIRROR], 0.5)


def test_pixel_beside_the_mirror_stays_what_it_is() -> None:
    assert not ON_MIRROR.all()
    radiance = np.full((*SHAPE, 3), 0.25)  # one of several samples may still see the rim
    fogged = GREY_FOG.apply(radiance, CAMERA, context_at_range(math.inf))
    np.testing.assert_array_equal(fogged[~ON_MIRROR], 0.25)


def test_air_when_it_is_clear_leaves_even_what_is_endlessly_far() -> None:
    clear, radiance = Fog(0.0, 0.5, 0.5, 0.5), make_test_pattern()
    np.testing.assert_array_equal(
        clear.apply(radiance, CAMERA, context_at_range(math.inf)), radiance
    )
    assert clear.bound(SceneSummary(1.0), CAMERA).value == 0.0
    assert clear.update_summary(SceneSummary(1.0)) == SceneSummary(1.0)


# Ranges and densities with optical depths from nearly 0 to opaque, and fogs darker and brighter
# than the scene.
CASES = [
    (10.0**step, range_m, airlight, largest)
    for step in range(-5, 1)
    for range_m in (0.5, 8.0, math.inf)
    for airlight in (0.02, 0.5, 1.5)
    for largest in (0.3, 4.0)
]


def test_criterion_over_a_grid_of_scenes_is_on_the_right_side_each_time() -> None:
    decisions = set()
    for density, range_m, airlight, largest in CASES:
        fog = Fog(density, airlight, airlight, airlight)
        bound = fog.bound(SceneSummary(largest, max_distance_m=range_m), CAMERA).value
        capture = context_at_range(np.float64(range_m))
        # Black, the brightest radiance, and radiances between.
        radiance = make_test_pattern(largest)
        radiance[40:56, 40:48] = 0.0
        radiance[40:56, 48:56] = min(largest, 1.0)
        measured = max_grey_level_change(fog, radiance, capture)
        assert measured <= bound * (1.0 + 1e-6) + 1e-9, (density, range_m, airlight, largest)
        if bound > THRESHOLD:
            assert measured > 0.5 * THRESHOLD, (density, range_m, airlight, largest)
        decisions.add(bound > THRESHOLD)
    assert decisions == {True, False}


def test_criterion_when_things_are_nearer_than_the_farthest_bounds_them_too() -> None:
    fog = Fog(0.01, 0.7, 0.7, 0.7)
    ranges = np.random.default_rng(3).uniform(0.0, 12.0, SHAPE)
    bound = fog.bound(SceneSummary(1.0, max_distance_m=12.0), CAMERA)
    assert max_grey_level_change(fog, make_test_pattern(), context_at_range(ranges)) <= bound.value
    assert bound.reason == "88.7 % of light passes 12 m of fog"


@pytest.mark.parametrize("airlight", [0.2, 3.0])
def test_summary_when_fog_is_brighter_than_the_scene_has_its_radiance(airlight: float) -> None:
    fog = replace(GREY_FOG, green=airlight)
    fogged = fog.apply(make_test_pattern(0.8), CAMERA, context_at_range(4.0))
    assert fogged.max() <= fog.update_summary(SceneSummary(0.8)).max_radiance


def test_background_when_it_has_the_fogs_own_light_does_not_call_for_thin_fog() -> None:
    thin = Fog(1e-5, 0.5, 0.5, 0.5)
    for level, enabled in ((0.5, False), (0.4, True)):
        summary = SceneSummary(1.0, max_distance_m=9.0, background_radiance=(level,) * 3)
        bound = thin.bound(summary, CAMERA)
        radiance = np.full((*SHAPE, 3), level)
        assert max_grey_level_change(thin, radiance, context_at_range(math.inf)) <= bound.value
        assert (bound.value > THRESHOLD) is enabled


def test_background_when_it_is_behind_fog_is_fog() -> None:
    behind = GREY_FOG.update_summary(SceneSummary(1.0, background_radiance=(0.1, 0.2, 0.3)))
    assert behind.background_radiance == (0.5, 0.5, 0.5)


def test_reason_states_the_source_of_the_bound() -> None:
    assert Fog(0.0, 0.5, 0.5, 0.5).bound(SceneSummary(1.0), CAMERA).reason == "the air is clear"
    dark = SceneSummary(0.5, max_distance_m=0.01, background_radiance=(0.0, 0.0, 0.0))
    assert "background" in GREY_FOG.bound(dark, CAMERA).reason
