"""The study's results as JSON and Markdown."""

from __future__ import annotations

import json

import numpy as np

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.degradation.degradation_report import (
    failure_table,
    format_degradation_report,
    summarise_degradation,
)
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.degradation_sweeps import DegradationLevel, DegradationSweep
from catoptra_studies.degradation.example_frame import ExampleFrame

LADDER = DegradationSweep(
    "Too dark",
    "no light",
    "light",
    (DegradationLevel("0.5", "A=1|B=2"), DegradationLevel("0.1", "A=2")),
    ini_keys="C=3",
)
SAMPLE = ExampleFrame(np.zeros((4, 4, 3), np.uint8), (), (), (), (2.0, 2.0))


def measured(found: int, ekf_max_m: float) -> DegradationMetrics:
    error = 0.5 if found else None
    return DegradationMetrics(200, 100, found, 0.25, error, error, ekf_max_m, 0.05, 2.0)


RESULT = SweepResult(
    LADDER,
    LevelResult("clean", {TRAINED_ON_CLEAN: measured(100, 0.1)}, SAMPLE),
    (
        LevelResult(
            "0.5",
            {TRAINED_ON_CLEAN: measured(80, 0.3), TRAINED_ON_DEGRADED: measured(100, 0.1)},
            SAMPLE,
        ),
        LevelResult(
            "0.1",
            {TRAINED_ON_CLEAN: measured(0, 2.0), TRAINED_ON_DEGRADED: measured(60, 0.2)},
            SAMPLE,
        ),
    ),
)


def test_document_has_rungs_keys_and_verdicts() -> None:
    told = json.loads(
        json.dumps(summarise_degradation([RESULT], num_runs=2, seed=7), allow_nan=False)
    )
    assert (told["version"], told["runs"], told["seed"]) == (1, 2, 7)
    (ladder,) = told["ladders"]
    assert ladder["keys"] == ["C=3"]
    assert ladder["clean"]["changed_grey_levels"] == 0.0
    assert [rung["keys"] for rung in ladder["rungs"]] == [["A=1", "B=2"], ["A=2"]]
    assert ladder["rungs"][0]["taught"][TRAINED_ON_DEGRADED]["rate"] == 1.0
    assert ladder["rungs"][1]["taught"][TRAINED_ON_CLEAN]["bearing_rms_deg"] is None
    assert ladder["verdicts"][TRAINED_ON_CLEAN] == {
        **{"falters": "0.5", "fails": "0.1", "drifts": "0.5", "lost": "0.1"}
    }
    assert ladder["verdicts"][TRAINED_ON_DEGRADED]["falters"] == "0.1"


def test_table_has_a_row_a_ladder_with_dashes_for_what_does_not_happen() -> None:
    *_, row = failure_table([RESULT])
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == ["Too dark", "light", "0.5 … 0.1", *("0.5", "0.1") * 2, "0.1", "–", "–"]


def test_page_has_every_rung_of_every_ladder() -> None:
    page = format_degradation_report([RESULT], num_runs=2)
    assert "2 drives of 100 frames" in page
    assert "\n## Too dark\n\nNo light.\n" in page
    assert "| clean | 0.0 | 100% | 0.25 | 0.50° | 500 mm | 0.10 m | 0.05 m |" in page
    assert "| 0.1 | 0.0 | 0% | 0.25 | – | – | 2.00 m | 0.05 m | 60% | 0.25 | 0.20 m |" in page
