from __future__ import annotations

from dataclasses import replace

from catoptra_studies.accuracy_cost.cost_report import format_localization
from catoptra_studies.accuracy_cost.cost_results import CostResults


def test_section_has_a_row_for_each_key_level_with_its_time(results: CostResults) -> None:
    text = format_localization(results)
    (row,) = (line for line in text.splitlines() if line.startswith("| 256 polygons"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:5] == ["7.0", "90%", "40%", "0.86"]


def test_section_names_the_coarsest_sufficient_level(results: CostResults) -> None:
    text = " ".join(format_localization(results).split())
    assert "within a centimetre of the best, 256 polygons (uv), 2x2 is enough" in text


def test_section_when_not_measured_is_empty(results: CostResults) -> None:
    assert format_localization(replace(results, localization=None)) == ""
