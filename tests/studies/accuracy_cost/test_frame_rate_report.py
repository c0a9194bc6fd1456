from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_studies.accuracy_cost.cost_report import format_frame_rates
from catoptra_studies.accuracy_cost.cost_results import CostResults


def with_times(results: CostResults, **cpu_ms: float) -> CostResults:
    rows = tuple(
        replace(row, cpu_ms=cpu_ms.get(f"n{row.payload}", row.cpu_ms))
        for row in results.frame_rates
    )
    return replace(results, frame_rates=rows)


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ({"n4096": 6.5}, "it does not depend, within 10%, as the paper found"),
        ({"n16": 5.0}, "within 10%, but for the part of the mirror that is left empty"),
        ({"n4096": 8.0}, "it depends by more than 10%"),
    ],
)
def test_conclusion_follows_from_the_processor_times(
    results: CostResults, times: dict[str, float], expected: str
) -> None:
    text = " ".join(format_frame_rates(with_times(results, **times)).split())
    assert expected in text


def test_section_has_the_cost_of_camera_and_scanner(results: CostResults) -> None:
    text = " ".join(format_frame_rates(results).split())
    assert "The camera with 1024 polygons takes 4.0 ms, the scanner 0.2." in text


def test_section_compares_the_camera_model_with_the_finest_mesh(
    results: CostResults,
) -> None:
    text = " ".join(format_frame_rates(results).split())
    assert "2.5 ms for the mirror and 5.0 ms a frame, where 256 polygons take 4.5 and 7.0" in text


def test_section_when_nothing_was_measured_is_empty(results: CostResults) -> None:
    assert format_frame_rates(replace(results, frame_rates=())) == ""
