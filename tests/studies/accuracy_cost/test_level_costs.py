from __future__ import annotations

import pytest

from catoptra_server.render.render_plan import PerPixel, RendererKind, RenderSettings
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel, measure_levels
from catoptra_studies.study_subject import open_study_subject
from helpers.configs import FIELD, OMNI_ROBOT

STEPS = (
    AccuracyLevel(
        "polygons", RendererKind.TRACE, RenderSettings(tessellation_from_polygon_count(16), 1)
    ),
    AccuracyLevel("one", RendererKind.TRACE, RenderSettings(PerPixel(), 1)),
    AccuracyLevel(
        "exact", RendererKind.TRACE, RenderSettings(PerPixel(), 4, stride_px=1), is_key=True
    ),
)


@pytest.fixture(scope="module")
def drawn() -> dict[str, MeasuredLevel]:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=60, num_poses=2) as subject:
        found = measure_levels(
            subject, STEPS, subject.render_reference(4), num_rounds=2, on_round=lambda: None
        )
    return {one.cost.name: one for one in found}


def test_error_when_a_step_is_the_reference_is_nothing(drawn: dict[str, MeasuredLevel]) -> None:
    exact = drawn["exact"].cost
    assert (exact.rmse, exact.ssim) == (0.0, pytest.approx(1.0))
    assert exact.is_key


def test_error_grows_from_samples_to_polygons(drawn: dict[str, MeasuredLevel]) -> None:
    assert 0.0 < drawn["one"].cost.rmse < drawn["polygons"].cost.rmse
    assert drawn["one"].cost.bound_max_px < 1e-3 < drawn["polygons"].cost.bound_max_px
    assert drawn["polygons"].cost.num_polygons == 16


def test_the_exact_step_is_on_the_front_and_stages_are_timed(
    drawn: dict[str, MeasuredLevel],
) -> None:
    assert drawn["exact"].cost.is_on_pareto_front
    assert all(one.cost.stage_ms["trace"] > 0.0 for one in drawn.values())
    assert drawn["one"].frame.shape == (60, 60, 3)
