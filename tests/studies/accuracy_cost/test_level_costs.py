from __future__ import annotations

import pytest

from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import PerPixel, RenderSettings
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel, measure_levels
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
