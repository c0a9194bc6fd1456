from __future__ import annotations

import re
from dataclasses import replace

import pytest

from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import CostResults


def find_section(results: CostResults, title: str) -> list[str]:
    """Lines of a section of the report."""
    text = format_cost_report(results).partition(f"## {title}")[2]
    return text.partition("\n## ")[0].splitlines()


def split_row(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def find_prose(results: CostResults) -> str:
    """The report in one line."""
    return " ".join(format_cost_report(results).split())


def test_report_has_every_section_and_names_machine_and_date(results: CostResults) -> None:
    text = format_cost_report(results)
    heads = re.findall(r"(?m)^## (\w+)", text)
    assert heads == ["The", "Every", "Mirror", "The", "Landmarks"]
    assert "2026-11-21" in text
    assert "a made-up machine" in text
    assert "quick run" in text


def test_levels_are_sorted_from_the_best_image_to_the_worst(results: CostResults) -> None:
    rows = [split_row(line) for line in find_section(results, "Every level") if "x" in line]
    assert [row[0] for row in rows if len(row) == 9][1:] == [
        *("exact, 2x2", "exact, 1x1", "256 polygons (uv), 2x2")
    ]


def test_front_compares_each_level_with_the_one_before(results: CostResults) -> None:
    section = "\n".join(find_section(results, "The Pareto front"))
    assert "+25% time, -39% RMSE" in section
    assert "No mirror mesh is on it" in section


def test_report_when_a_polygon_row_disagrees_names_it(results: CostResults) -> None:
    row = replace(results.polygon_rows[0], rms_px=1.0)
    text = format_cost_report(replace(results, polygon_rows=(row,)))
    assert "0 of 1 agree" in text
    assert "Not so 16 x 16 uv" in text


def test_report_without_a_reference_has_no_columns_for_one(results: CostResults) -> None:
    row = replace(results.polygon_rows[0], reference_rms_px=0.0, reference_max_px=0.0)
    lines = find_section(replace(results, polygon_rows=(row,)), "Mirror meshes")
    assert split_row(lines[2]) == ["polygons", "covered", "rms px", "largest px"]
    assert split_row(lines[4]) == ["256 = 16 x 16, uv", "0.975", "2.95", "7.28"]


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
    assert rows[3].count(" - |") == 4  # not driven by
    # Both filters, each under its name.
    assert split_row(rows[0])[-2:] == [
        "paper's filter, mean error",
        "consistent filter, mean error",
    ]
    assert split_row(rows[2])[-2:] == ["0.040 m", "0.026 m"]


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ({"4096": 6.5}, "it does not depend, within 10%, as the paper found"),
        ({"16": 5.0}, "within 10%, but for the part of the mirror that is left empty"),
        ({"4096": 8.0}, "it depends by more than 10%"),
    ],
)
def test_conclusion_follows_from_the_processor_times(
    results: CostResults, times: dict[str, float], expected: str
) -> None:
    rows = tuple(
        replace(row, cpu_ms=times.get(row.payload, row.cpu_ms)) for row in results.frame_rates
    )
    assert expected in find_prose(replace(results, frame_rates=rows))


@pytest.mark.parametrize(
    "sentence",
    [
        "The camera with 1024 polygons takes 4.0 ms of it, the scanner 0.2.",
        "Measured on noon, load by others: 0.2 of 2 processors (field raster).",
        "2.5 ms for the mirror and 5.0 ms a frame, where 256 polygons take 4.5 and 7.0",
        "within a centimetre of the best, 256 polygons (uv), 2x2 is enough",
    ],
)
def test_report_states_what_follows_from_the_numbers(results: CostResults, sentence: str) -> None:
    assert sentence in find_prose(results)


def test_section_has_a_row_for_each_key_level_with_its_time(results: CostResults) -> None:
    lines = find_section(results, "Landmarks and localization")
    (row,) = (line for line in lines if line.startswith("| 256 polygons"))
    assert split_row(row)[1:5] == ["7.0", "90%", "40%", "0.86"]
