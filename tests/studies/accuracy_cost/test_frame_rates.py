from __future__ import annotations

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.render_plan import RendererKind
from catoptra_studies.accuracy_cost.cost_results import FrameRate
from catoptra_studies.accuracy_cost.frame_rates import frame_time_spread, measure_frame_rates
from catoptra_studies.study_subject import open_study_subject
from helpers.configs import FIELD, OMNI_ROBOT


def row(polygons: int, processor_ms: float) -> FrameRate:
    return FrameRate("field", "trace", str(polygons), polygons, 0.0, 0.0, processor_ms, {})


def test_spread_is_of_the_dearest_over_the_cheapest_mesh() -> None:
    rows = (row(0, 1.0), row(16, 8.0), row(256, 10.0), row(4096, 11.0))
    assert frame_time_spread(rows, min_polygons=16) == pytest.approx(0.375)
    assert frame_time_spread(rows, min_polygons=256) == pytest.approx(0.1)


def test_loads_are_those_of_the_papers_figure_and_more_polygons() -> None:
    drive = read_robot(OMNI_ROBOT)[0].drive
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=32, num_poses=1) as subject:
        rows = measure_frame_rates(
            subject, drive, RendererKind.TRACE, num_rounds=1, on_round=lambda: None
        )
    loads = [row.payload for row in rows]
    assert loads == ["no camera", "16", "64", "256", "1024", "4096", "per pixel", "LMS200"]
    assert [row.num_polygons for row in rows] == [0, 16, 64, 256, 1024, 4096, 0, 0]
    assert rows[-1].stage_ms.keys() == {"screen", "scanner"}
    assert all(row.fps == pytest.approx(1e3 / row.wall_ms) for row in rows)
