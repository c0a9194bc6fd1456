"""Cost model: recovery of known rates, and prediction of other plans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.frames.plan.costs import (
    CostModel,
    PlanTiming,
    cost_group,
    describe_rates,
    fit_cost_model,
    fit_nonnegative_rates,
)
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=640)
RATES = {"faces": (2.0, 20.0, 5.0), "mirror": (0.5, 9.0, 3.0), "readback": (0.3, 0.0)}
TRUE_MODEL = CostModel(CAMERA, {"raster": RATES})


def make_plan(kind: RendererKind, samples: int, texels_per_px: float = 1.0) -> RenderPlan:
    settings = RenderSettings(samples=samples, texels_per_px=texels_per_px)
    return plan_from_settings(settings, CAMERA, kind=kind, reason="test")


def raster_plan(samples: int, texels_per_px: float, face_samples: int = 1) -> RenderPlan:
    plan = make_plan(RendererKind.RASTER, samples, texels_per_px)
    return replace(plan, face_samples=face_samples)


MEASURED_PLANS = [
    raster_plan(1, 0.5),
    raster_plan(1, 1.0),
    raster_plan(2, 1.0),
    raster_plan(1, 1.0, 4),
]


def test_model_fitted_to_a_few_plans_predicts_others() -> None:
    model = fit_cost_model(
        CAMERA, [PlanTiming(plan, TRUE_MODEL.predict_stage_ms(plan)) for plan in MEASURED_PLANS]
    )
    for plan in (raster_plan(8, 0.5), raster_plan(3, 4.0), raster_plan(4, 2.0, 4)):
        assert model.predict_frame_ms(plan) == pytest.approx(
            TRUE_MODEL.predict_frame_ms(plan), rel=1e-6
        )


def test_rates_in_a_log_are_words_and_rounded_numbers() -> None:
    rates = {"raster": {"faces": (1.5591839844747946, 3.794824941659078), "other": (0.05, 0.0)}}
    assert describe_rates(rates) == (
        "raster faces 1.56 ms + 3.79 ms/million; raster other 0.05 ms + 0 ms/million"
    )


def test_model_of_noisy_times_has_no_negative_rates() -> None:
    rng = np.random.default_rng(3)
    measured = [
        PlanTiming(
            p, {s: ms * rng.uniform(0.7, 1.3) for s, ms in TRUE_MODEL.predict_stage_ms(p).items()}
        )
        for p in MEASURED_PLANS
    ]
    rates = fit_cost_model(CAMERA, measured).rates["raster"]
    assert all(rate >= 0.0 for stage in rates.values() for rate in stage)


def test_rates_of_decreasing_times_are_their_mean() -> None:
    amounts = np.array([[1.0, 1.0], [1.0, 2.0]])
    fixed, growing = fit_nonnegative_rates(amounts, np.array([2.0, 1.0]))
    assert growing == 0.0
    assert 1.0 < fixed < 2.0


def test_cost_group_separates_renderers() -> None:
    plans = (make_plan(RendererKind.TRACE, 1), raster_plan(1, 1.0))
    assert len({cost_group(plan) for plan in plans}) == 2


def test_prediction_for_an_unmeasured_group_raises() -> None:
    with pytest.raises(KeyError, match="trace"):
        TRUE_MODEL.predict_frame_ms(make_plan(RendererKind.TRACE, 1))


@pytest.mark.parametrize("rates", [(1.0, 20.0, 0.0), (1.0, 0.0, 9.0), (0.5, 12.0, 3.0)])
def test_model_of_trace_predicts_between_all_samples_and_those_of_edges(
    rates: tuple[float, ...],
) -> None:
    true = CostModel(CAMERA, {"trace": {"trace": rates}})
    plans = [make_plan(RendererKind.TRACE, samples) for samples in range(1, 9)]
    measured = [PlanTiming(plans[i], true.predict_stage_ms(plans[i])) for i in (0, 1, 4)]
    model = fit_cost_model(CAMERA, measured)
    for plan in plans:
        assert model.predict_frame_ms(plan) == pytest.approx(true.predict_frame_ms(plan))
