from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.frame_rate_report import format_frame_rates


def with_times(document: CostResults, **processor_ms: float) -> CostResults:
    rows = tuple(
        replace(row, cpu_ms=processor_ms.get(f"n{row.payload}", row.cpu_ms))
        for row in document.frame_rates
    )
    return replace(document, frame_rates=rows)


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ({"n4096": 6.5}, "it does not depend, within 10%, as the paper found"),
        ({"n16": 5.0}, "within 10%, but for the part of the mirror that is left empty"),
        ({"n4096": 8.0}, "it depends by more than 10%"),
    ],
)
def test_verdict_follows_from_the_processor_times(
    document: CostResults, times: dict[str, float], expected: str
) -> None:
    told = " ".join(format_frame_rates(with_times(document, **times)).split())
    assert expected in told


def test_section_tells_the_camera_and_the_scanner_apart(document: CostResults) -> None:
    told = " ".join(format_frame_rates(document).split())
    assert "The camera with 1024 polygons takes 4.0 ms, the scanner 0.2." in told


def test_section_says_what_the_exact_law_takes_beside_the_finest_mesh(
    document: CostResults,
) -> None:
    told = " ".join(format_frame_rates(document).split())
    assert "2.5 ms for the mirror and 5.0 ms a frame, where 256 polygons take 4.5 and 7.0" in told


def test_section_when_nothing_was_measured_is_empty(document: CostResults) -> None:
    assert format_frame_rates(replace(document, frame_rates=())) == ""
