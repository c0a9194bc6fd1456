from __future__ import annotations

import re
from dataclasses import replace

from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import CostResults


def test_report_has_every_section_and_names_machine_and_date(results: CostResults) -> None:
    text = format_cost_report(results)
    heads = re.findall(r"(?m)^## (\w+)", text)
    assert heads == ["The", "Every", "Mirror", "The", "Landmarks"]
    assert "2026-11-21" in text
    assert "a made-up machine" in text
    assert "quick run" in text


def test_levels_are_sorted_from_the_best_image_to_the_worst(results: CostResults) -> None:
    section = (
        format_cost_report(results).partition("## Every level")[2].partition("## Mirror meshes")[0]
    )
    names = re.findall(r"(?m)^\| (\w.*?) +\|", section)[1:]
    assert names == ["exact, 2x2", "exact, 1x1", "256 polygons (uv), 2x2"]


def test_front_compares_each_level_with_the_one_before(results: CostResults) -> None:
    section = (
        format_cost_report(results)
        .partition("## The Pareto front")[2]
        .partition("## Every level")[0]
    )
    assert "+25% time, -39% RMSE" in section
    assert "No mirror mesh is on it" in section


def test_report_when_a_polygon_row_disagrees_names_it(results: CostResults) -> None:
    row = replace(results.polygon_rows[0], rms_px=1.0)
    text = format_cost_report(replace(results, polygon_rows=(row,)))
    assert "0 of 1 agree" in text
    assert "Not so 16 x 16 uv" in text


def test_report_when_no_robot_was_driven_has_no_localization(results: CostResults) -> None:
    text = format_cost_report(replace(results, localization=None, frame_rates=()))
    assert "Landmarks" not in text
    assert "Figure 10" not in text


def test_prose_of_the_report_is_wrapped(results: CostResults) -> None:
    lines = format_cost_report(results).splitlines()
    assert [line for line in lines if len(line) > 100 and not line.startswith("|")] == []


def test_short_table_has_a_row_for_each_key_level(results: CostResults) -> None:
    rows = format_summary_table(results).splitlines()
    assert len(rows) == 2 + len(results.levels)
    assert "90%" in rows[2]
    assert rows[3].count(" - |") == 3  # not driven by
