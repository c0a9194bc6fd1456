from __future__ import annotations

from dataclasses import replace

from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.localization_report import format_localization


def test_section_has_a_row_for_each_driven_step_with_its_time(document: CostResults) -> None:
    told = format_localization(document)
    (row,) = (line for line in told.splitlines() if line.startswith("| 256 polygons"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:5] == ["7.0", "90%", "40%", "0.86"]


def test_section_names_the_coarsest_step_that_is_enough(document: CostResults) -> None:
    told = " ".join(format_localization(document).split())
    assert "within a centimetre of the best, 256 polygons (uv), 2x2 is enough" in told


def test_section_when_not_measured_is_empty(document: CostResults) -> None:
    assert format_localization(replace(document, localization=None)) == ""
