"""Motion, fog, noise seed and shutter of an exposure, each against its formula."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.objects import (
    INSTANTANEOUS,
    MAX_TIME_SAMPLES,
    FogMedium,
    NoiseSeed,
    Shutter,
    scene_twist_in_mirror,
)
from catoptra_server.world.world_description import AT_REST, Twist
from helpers.effect_measurement import DRIVING_STATE, DYNAMIC_OBJECT
from helpers.motion_reference import camera_state_after, relative_twist


@pytest.mark.parametrize("twist", [AT_REST, Twist((0.0, -0.6, 0.0), (0.3, 0.0, 1.0))])
def test_relative_twist_when_applied_moves_points_as_in_the_mirror_frame(twist: Twist) -> None:
    dynamic_object, step_s = replace(DYNAMIC_OBJECT, twist=twist), 1e-6
    point = np.array((1.1, 0.4, -0.2))
    offset = point - dynamic_object.world_from_object.translation
    velocity = twist.at_offset(offset).linear_m_s
    local = DRIVING_STATE.world_from_mirror.inverse().transform_points(point)
    later = camera_state_after(DRIVING_STATE, step_s).world_from_mirror.inverse()
    moved = later.transform_points(point + step_s * np.asarray(velocity))
    relative = relative_twist(DRIVING_STATE, dynamic_object).at_offset(local)
    np.testing.assert_allclose(relative.linear_m_s, (moved - local) / step_s, atol=1e-5)


def test_twist_of_the_scene_is_that_of_an_object_at_rest() -> None:
    scene = scene_twist_in_mirror(DRIVING_STATE)
    at_rest = relative_twist(DRIVING_STATE, replace(DYNAMIC_OBJECT, twist=AT_REST))
    np.testing.assert_allclose(scene.linear_m_s, at_rest.linear_m_s, atol=1e-15)
    np.testing.assert_allclose(scene.angular_rad_s, at_rest.angular_rad_s, atol=1e-15)
    assert scene_twist_in_mirror(replace(DRIVING_STATE, twist=AT_REST)) == AT_REST


FOG = FogMedium(0.5, (0.6, 0.5, 0.4))


def test_light_of_a_black_surface_is_the_airlight_before_it() -> None:
    mixed = FOG.mix(np.zeros((1, 3)), np.array([2.0]))
    np.testing.assert_allclose(mixed, (1.0 - math.exp(-1.0)) * np.array([FOG.airlight]))


def test_light_without_a_distance_is_the_surfaces_and_at_infinity_the_airlight() -> None:
    mixed = FOG.mix(np.ones((2, 3)), np.array([0.0, np.inf]))
    np.testing.assert_array_equal(mixed, [(1.0, 1.0, 1.0), FOG.airlight])


def test_white_and_black_at_the_visual_range_differ_by_5_percent() -> None:
    # Koschmieder: the visibility is ln(20) / beta.
    range_m = np.array(math.log(20.0) / FOG.density_per_m)
    contrast = FOG.mix(np.ones(3), range_m) - FOG.mix(np.zeros(3), range_m)
    np.testing.assert_allclose(contrast, 0.05, rtol=1e-12)


def test_transmittance_of_any_fog_is_1_at_no_distance_and_0_at_infinity() -> None:
    ranges = np.array([0.0, 2.0, 1e6, np.inf])
    np.testing.assert_allclose(FOG.transmittance(ranges), [1.0, math.exp(-1.0), 0.0, 0.0])


def test_seed_of_a_source_has_two_words_of_32_bits() -> None:
    key = NoiseSeed.from_source(RandomSource((0x1122334455667788, 9)), 5)
    assert key == NoiseSeed((0x55667788, 0x11223344), 5)


def test_seed_differs_between_cameras() -> None:
    keys = {
        NoiseSeed.from_source(RandomSource.from_names(1, "Mine", name), 0)
        for name in ("Left", "Right")
    }
    assert len(keys) == 2


ROWS = 10


@pytest.mark.parametrize(
    "shutter",
    [Shutter(0.04, 0.0, 5), Shutter(0.0, 0.03, 7), Shutter(0.02, 0.05, 8), Shutter(0.01, 0.0, 1.2)],
)
def test_weights_of_a_row_sum_to_one_with_the_mean_at_the_time_of_the_row(shutter: Shutter) -> None:
    weights = shutter.row_weights(ROWS)
    assert weights.shape == (shutter.num_time_samples, ROWS)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, rtol=1e-6)
    centre_s = shutter.readout_s * ((np.arange(ROWS) + 0.5) / ROWS - 0.5)
    slot_s = (shutter.exposure_s + shutter.readout_s) / shutter.num_time_samples
    mean_s = np.asarray(shutter.times_s) @ weights
    assert np.abs(mean_s - centre_s).max() <= 0.5 * slot_s + 1e-9


def test_global_shutter_weights_all_time_samples_equally() -> None:
    np.testing.assert_allclose(Shutter(0.04, 0.0, 4).row_weights(3), 0.25)
    assert Shutter(0.04, 0.0, 4).times_s == pytest.approx((-0.015, -0.005, 0.005, 0.015))


def test_rows_without_an_exposure_have_one_time_sample_each_in_order() -> None:
    weights = Shutter(0.0, 0.02, 4).row_weights(8)
    assert weights.argmax(axis=0).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize(
    ("exposure_px", "readout_px", "time_samples"),
    [
        (0.2, 0.0, 2),
        (1.0, 0.0, 2),
        (3.2, 0.0, 4),
        (0.0, 3.2, 13),
        (2.0, 1.0, 6),
        (1e4, 0.0, MAX_TIME_SAMPLES),
        (math.inf, 0.0, MAX_TIME_SAMPLES),
    ],
)
def test_time_samples_when_chosen_are_a_pixel_apart_and_a_quarter_for_rows(
    exposure_px: float, readout_px: float, time_samples: int
) -> None:
    shutter = INSTANTANEOUS.add_readout(0.0, readout_px).add_exposure(0.01, exposure_px)
    assert shutter.num_time_samples == time_samples


@pytest.mark.parametrize(("limit", "time_samples"), [(10, 10), (64, 33), (3, 3), (0, 2)])
def test_time_samples_are_limited_but_never_fewer_than_two(limit: int, time_samples: int) -> None:
    shutter = Shutter(0.01, 0.0, 33.0, max_time_samples=limit)
    assert shutter.num_time_samples == len(shutter.times_s) == time_samples
    np.testing.assert_allclose(shutter.row_weights(3).sum(axis=0), 1.0, rtol=1e-6)
