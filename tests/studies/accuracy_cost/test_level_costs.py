from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.render.renderer import Image, PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel
from catoptra_studies.accuracy_cost.level_costs import (
    MeasuredLevel,
    compute_image_error,
    measure_levels,
)
from catoptra_studies.study_subject import open_study_subject
from helpers.configs import FIELD, OMNI_ROBOT

LEVELS = (
    AccuracyLevel(
        "polygons", RendererKind.TRACE, RenderSettings(tessellation_from_polygon_count(16), 1)
    ),
    AccuracyLevel("one", RendererKind.TRACE, RenderSettings(PerPixel(), 1)),
    AccuracyLevel("exact", RendererKind.TRACE, RenderSettings(PerPixel(), 4), is_key=True),
)


@pytest.fixture(scope="module")
def levels() -> dict[str, MeasuredLevel]:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=60, num_poses=2) as subject:
        measured = measure_levels(
            subject, LEVELS, subject.render_reference(4), num_rounds=2, on_round=lambda: None
        )
    return {one.cost.name: one for one in measured}


def test_error_when_a_level_is_the_reference_is_zero(levels: dict[str, MeasuredLevel]) -> None:
    exact = levels["exact"].cost
    assert (exact.rmse, exact.ssim) == (0.0, pytest.approx(1.0))
    assert exact.is_key


def test_error_when_polygons_are_coarse_exceeds_that_of_one_sample(
    levels: dict[str, MeasuredLevel],
) -> None:
    assert 0.0 < levels["one"].cost.rmse < levels["polygons"].cost.rmse
    assert levels["one"].cost.bound_max_px < 1e-3 < levels["polygons"].cost.bound_max_px
    assert levels["polygons"].cost.num_polygons == 16


def test_exact_level_when_measured_is_on_the_front_with_stage_times(
    levels: dict[str, MeasuredLevel],
) -> None:
    assert levels["exact"].cost.is_on_pareto_front
    assert all(one.cost.stage_ms["trace"] > 0.0 for one in levels.values())
    assert levels["one"].frame.shape == (60, 60, 3)


EVERYWHERE = np.ones((32, 32), dtype=np.bool_)
MIDDLE = np.zeros_like(EVERYWHERE)
MIDDLE[16, 16] = True


def grey(value: int) -> Image:
    return np.full((32, 32, 3), value, dtype=np.uint8)


def checks(low: int, high: int) -> Image:
    board = np.indices((32, 32)).sum(axis=0) % 2
    return np.repeat(np.where(board, high, low)[..., None], 3, axis=-1).astype(np.uint8)


def test_ssim_when_two_greys_are_flat_is_the_brightness_term_alone() -> None:
    # By hand: (2 100 120 + C1) / (100^2 + 120^2 + C1) with C1 = 2.55^2; no structure differs.
    expected = (2 * 100 * 120 + 6.5025) / (100**2 + 120**2 + 6.5025)
    found = compute_image_error([(grey(100), grey(120))], EVERYWHERE).ssim
    assert found == pytest.approx(expected, abs=1e-9)


def test_ssim_when_a_pattern_is_inverted_is_the_negative_contrast_term() -> None:
    # Means 110 each; variances 100 each and covariance -100 where the window sees both halves
    # alike: (-200 + C2) / (200 + C2) with C2 = 7.65^2. The Gaussian's halves differ by 1e-9.
    middle = compute_image_error([(checks(100, 120), checks(120, 100))], MIDDLE).ssim
    assert middle == pytest.approx((-200 + 58.5225) / (200 + 58.5225), abs=1e-4)


RED_OFF, UPPER_OFF = grey(100).copy(), grey(100).copy()
RED_OFF[..., 0] += 30
UPPER_OFF[:16] = 255
LOWER = np.arange(32)[:, None] >= 16 + np.zeros(32)


@pytest.mark.parametrize(
    ("pairs", "mask", "rmse"),
    [
        ([(RED_OFF, grey(100))], EVERYWHERE, 30 / math.sqrt(3)),
        ([(UPPER_OFF, grey(100))], LOWER, 0.0),
        ([(grey(100), grey(100)), (grey(110), grey(100))], EVERYWHERE, 10 / math.sqrt(2)),
    ],
    ids=["one channel off counts all three", "pixels that do not count", "several pairs"],
)
def test_rmse_is_that_of_all_pixels_that_count(pairs, mask, rmse) -> None:
    assert compute_image_error(pairs, mask).rmse == pytest.approx(rmse)


def test_psnr_is_20_db_a_decade_and_endless_for_equal_pictures() -> None:
    by_difference = [
        compute_image_error([(grey(grey_levels), grey(0))], EVERYWHERE).psnr_db
        for grey_levels in (255, 51, 0)
    ]
    # A fifth of 255 is 14 dB.
    assert by_difference == [0.0, pytest.approx(20.0 * math.log10(5.0)), math.inf]
