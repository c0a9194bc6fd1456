from __future__ import annotations

import re

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_studies.camera_figures import frame_rates
from catoptra_studies.camera_figures.frame_rates import (
    NUM_WARM_UP_ROUNDS,
    DrawFunction,
    FrameRate,
    frame_time_spread,
    measure_frame_rates,
    time_round_robin,
)
from catoptra_studies.study_subject import open_study_subject
from helpers.configs import FIELD, OMNI_ROBOT


def make_row(polygons: int, cpu_ms: float) -> FrameRate:
    return FrameRate("field", "trace", "idle", str(polygons), polygons, 0.0, 0.0, cpu_ms, {})


def test_spread_compares_the_slowest_with_the_fastest_mesh() -> None:
    rows = (make_row(0, 1.0), make_row(16, 8.0), make_row(256, 10.0), make_row(4096, 11.0))
    assert frame_time_spread(rows, min_polygons=16) == pytest.approx(0.375)
    assert frame_time_spread(rows, min_polygons=256) == pytest.approx(0.1)


def test_payloads_are_those_of_the_papers_figure_and_4096_polygons() -> None:
    drive = read_robot(OMNI_ROBOT)[0].drive
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=32, num_poses=1) as subject:
        rows = measure_frame_rates(
            subject, drive, RendererKind.TRACE, num_rounds=1, on_round=lambda: None
        )
    payloads = [row.payload for row in rows]
    assert payloads == ["no camera", "16", "64", "256", "1024", "4096", "per pixel", "LMS200"]
    assert [row.num_polygons for row in rows] == [0, 16, 64, 256, 1024, 4096, 0, 0]
    assert {row.conditions for row in rows} == {rows[0].conditions}
    load = r"\d{4}-\d\d-\d\d, load by others: \d+\.\d of \d+ processors"
    assert re.fullmatch(load, rows[0].conditions)
    assert rows[-1].stage_ms.keys() == {"perspective", "scanner"}
    assert all(row.fps == pytest.approx(1e3 / row.wall_ms) for row in rows)


def test_draws_take_turns_and_every_round_is_told() -> None:
    calls: list[tuple[str, int]] = []
    rounds: list[int] = []

    def named(name: str) -> DrawFunction:
        def draw(number: int) -> dict[str, float]:
            calls.append((name, number))
            return {}

        return draw

    time_round_robin(
        [named("a"), named("b")], num_rounds=2, on_round=lambda: rounds.append(len(calls))
    )
    expected = [(name, n) for n in range(NUM_WARM_UP_ROUNDS + 2) for name in "ab"]
    assert calls == expected
    assert rounds == list(range(2, len(expected) + 1, 2))


def test_stages_are_medians_without_the_warm_up() -> None:
    times = iter([*(1000.0,) * NUM_WARM_UP_ROUNDS, 1.0, 9.0, 2.0])
    (took,) = time_round_robin(
        [lambda _: {"trace": next(times)}], num_rounds=3, on_round=lambda: None
    )
    assert took.stage_ms == {"trace": 2.0}
    assert took.wall_ms >= 0.0


def test_load_counts_the_other_programs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    # Ten seconds: twelve of processors, four of them this program's.
    clocks = {"busy": iter((100.0, 112.0)), "own": iter((1.0, 5.0)), "wall": iter((50.0, 60.0))}
    monkeypatch.setattr(frame_rates, "_busy_s", lambda: next(clocks["busy"]))
    monkeypatch.setattr(frame_rates.time, "process_time", lambda: next(clocks["own"]))
    monkeypatch.setattr(frame_rates.time, "perf_counter", lambda: next(clocks["wall"]))
    monkeypatch.setattr(frame_rates.os, "cpu_count", lambda: 2)
    with frame_rates._measure_load() as load:
        assert load == []
    assert load == ["load by others: 0.8 of 2 processors"]
