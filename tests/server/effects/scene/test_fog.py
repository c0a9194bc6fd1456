"""Criterion of fog against the law of its medium, and the camera state."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.world.objects import FogMedium
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, THRESHOLD, make_test_pattern
from helpers.worlds import CAMERA_STATE

SHAPE = (CAMERA.height_px, CAMERA.width_px)
GREY_FOG = Fog(0.2, 0.5, 0.5, 0.5)


def mix(fog: Fog, radiance: Floats, range_m: Floats | float) -> Floats:
    assert fog.medium is not None
    return fog.medium.mix(radiance, np.asarray(range_m, dtype=np.float64))


def max_grey_level_change(fog: Fog, image: Floats, range_m: Floats | float) -> float:
    """Largest change of a pixel, grey levels."""
    fogged = mix(fog, image, range_m)
    return 255.0 * float(np.abs(srgb_from_linear(fogged) - srgb_from_linear(image)).max())


def test_camera_state_in_fog_has_the_medium_and_in_clear_air_none() -> None:
    in_fog = Fog(0.2, 0.3, 0.4, 0.5).apply_to_scene(CAMERA_STATE, 0.0)
    assert in_fog.fog == FogMedium(0.2, (0.3, 0.4, 0.5))
    clear = Fog(0.0, 0.3, 0.4, 0.5)
    assert clear.apply_to_scene(CAMERA_STATE, 0.0).fog is None
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
        # Black, the brightest radiance, and radiances between.
        radiance = make_test_pattern(largest)
        radiance[40:56, 40:48] = 0.0
        radiance[40:56, 48:56] = min(largest, 1.0)
        measured = max_grey_level_change(fog, radiance, range_m)
        assert measured <= bound * (1.0 + 1e-6) + 1e-9, (density, range_m, airlight, largest)
        if bound > THRESHOLD:
            assert measured > 0.5 * THRESHOLD, (density, range_m, airlight, largest)
        decisions.add(bound > THRESHOLD)
    assert decisions == {True, False}


def test_criterion_when_things_are_nearer_than_the_farthest_bounds_them_too() -> None:
    fog = Fog(0.01, 0.7, 0.7, 0.7)
    ranges = np.random.default_rng(3).uniform(0.0, 12.0, SHAPE)
    bound = fog.bound(SceneSummary(1.0, max_distance_m=12.0), CAMERA)
    assert max_grey_level_change(fog, make_test_pattern(), ranges) <= bound.value
    assert bound.reason == "88.7 % of light passes 12 m of fog"


@pytest.mark.parametrize("airlight", [0.2, 3.0])
def test_summary_when_fog_is_brighter_than_the_scene_has_its_radiance(airlight: float) -> None:
    fog = replace(GREY_FOG, green=airlight)
    fogged = mix(fog, make_test_pattern(0.8), 4.0)
    assert fogged.max() <= fog.update_summary(SceneSummary(0.8)).max_radiance


def test_background_when_it_has_the_fogs_own_light_does_not_call_for_thin_fog() -> None:
    thin = Fog(1e-5, 0.5, 0.5, 0.5)
    for level, enabled in ((0.5, False), (0.4, True)):
        summary = SceneSummary(1.0, max_distance_m=9.0, background_radiance=((level,) * 3,) * 2)
        bound = thin.bound(summary, CAMERA)
        radiance = np.full((*SHAPE, 3), level)
        assert max_grey_level_change(thin, radiance, math.inf) <= bound.value
        assert (bound.value > THRESHOLD) is enabled


def test_background_when_it_is_behind_fog_is_fog() -> None:
    behind = GREY_FOG.update_summary(SceneSummary(1.0, background_radiance=((0.1, 0.2, 0.3),) * 2))
    assert behind.background_radiance == ((0.5, 0.5, 0.5),) * 2


def test_reason_states_the_source_of_the_bound() -> None:
    assert Fog(0.0, 0.5, 0.5, 0.5).bound(SceneSummary(1.0), CAMERA).reason == "the air is clear"
    dark = SceneSummary(0.5, max_distance_m=0.01, background_radiance=((0.0,) * 3,) * 2)
    assert "background" in GREY_FOG.bound(dark, CAMERA).reason
