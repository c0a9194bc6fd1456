"""Results with invented numbers, whose report does not depend on any machine."""

from __future__ import annotations

import pytest

from catoptra_studies.accuracy_cost.cost_results import (
    CostResults,
    LevelCost,
    LocalizationAccuracy,
    LocalizationRow,
    PolygonRow,
    StudyConditions,
)
from catoptra_studies.camera_figures.frame_rates import FrameRate


def make_level(
    name: str, *, ms: float, rmse: float, polygons: int = 0, samples: int = 2
) -> LevelCost:
    return LevelCost(
        name=name,
        renderer="raster",
        num_polygons=polygons,
        samples=samples,
        face_size_px=360,
        is_key=True,
        robot_ini="[Catoptra.HyperbolicMirror]\nPolygons=0\n",
        wall_ms=ms,
        cpu_ms=2.0 * ms,
        stage_ms={"faces": 2.5, "mirror": ms - 2.5},
        bound_max_px=0.58,
        bound_rms_px=0.24,
        bound_max_deg=0.5,
        rmse=rmse,
        psnr_db=36.0,
        ssim=0.99,
        is_on_pareto_front=not polygons,
    )


def make_frame_rate(payload: str, ms: float) -> FrameRate:
    polygons = int(payload) if payload.isdigit() else 0
    return FrameRate(
        "field", "raster", "noon, load by others: 0.2 of 2 processors",
        payload, polygons, 1e3 / ms, ms, ms, {"perspective": 2.0},
    )  # fmt: skip


@pytest.fixture
def results() -> CostResults:
    return CostResults(
        conditions=StudyConditions(
            date="2026-11-21",
            machine="a made-up machine",
            renderers=("raster: none",),
            robot="p2at_omni",
            world="field",
            size_px=360,
            is_quick=True,
            num_rounds=6,
            num_poses=2,
            reference_samples=8,
        ),
        levels=(
            make_level("exact, 2x2", ms=5.0, rmse=3.7),
            make_level("256 polygons (uv), 2x2", ms=7.0, rmse=25.0, polygons=256),
            make_level("exact, 1x1", ms=4.0, rmse=6.1, samples=1),
        ),
        polygon_rows=(PolygonRow(256, 16, 16, "uv", 0.975, 2.95, 7.28, 2.95, 7.28),),
        frame_rates=(
            make_frame_rate("no camera", 2.0),
            *(make_frame_rate(str(count), 6.0) for count in (16, 64, 256, 1024, 4096)),
            make_frame_rate("per pixel", 5.0),
            make_frame_rate("LMS200", 2.2),
        ),
        localization=LocalizationAccuracy(
            num_runs=5,
            steps_per_run=100,
            odometry_max_m=1.9,
            rows=(
                LocalizationRow(
                    "256 polygons (uv), 2x2", 500, 0.4, 0.9, 0.86, 0.1, 0.05, 0.1, 0.03, 0.07
                ),
                LocalizationRow("exact, 2x2", 500, 0.9, 1.0, 0.05, 0.01, 0.04, 0.1, 0.026, 0.09),
            ),
        ),
    )
