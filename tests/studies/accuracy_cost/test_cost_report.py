from __future__ import annotations

import re
from dataclasses import replace

from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import CostResults


def test_report_has_every_part_and_names_machine_and_date(document: CostResults) -> None:
    told = format_cost_report(document)
    heads = re.findall(r"(?m)^## (\w+)", told)
    assert heads == ["The", "Every", "Polygons", "The", "What"]
    assert "2026-11-21" in told
    assert "a made-up machine" in told
    assert "quick look" in told


def test_steps_stand_from_the_best_picture_to_the_worst(document: CostResults) -> None:
    section = format_cost_report(document).partition("## Every step")[2].partition("## Polygons")[0]
    names = re.findall(r"(?m)^\| (\w.*?) +\|", section)[1:]
    assert names == ["exact, 2x2", "exact, 1x1", "256 polygons (uv), 2x2"]


def test_front_says_what_each_step_buys(document: CostResults) -> None:
    section = (
        format_cost_report(document).partition("## The front")[2].partition("## Every step")[0]
    )
    assert "+25% time, -39% RMSE" in section
    assert "No polygon mirror is on it" in section


def test_report_when_a_polygon_row_disagrees_names_it(document: CostResults) -> None:
    row = replace(document.polygon_rows[0], rms_px=1.0)
    told = format_cost_report(replace(document, polygon_rows=(row,)))
    assert "0 of 1 agree" in told
    assert "Not so 16 x 16 uv" in told


def test_report_when_the_client_has_not_measured_has_no_landmarks(document: CostResults) -> None:
    told = format_cost_report(replace(document, localization=None, frame_rates=()))
    assert "landmarks" not in told
    assert "Figure 10" not in told


def test_prose_of_the_report_is_wrapped(document: CostResults) -> None:
    lines = format_cost_report(document).splitlines()
    assert [line for line in lines if len(line) > 100 and not line.startswith("|")] == []


def test_short_table_has_a_row_for_each_key_step(document: CostResults) -> None:
    rows = format_summary_table(document).splitlines()
    assert len(rows) == 2 + len(document.levels)
    assert "90%" in rows[2]
    assert rows[3].count(" - |") == 3  # not driven by
