"""The study's results as JSON and Markdown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics, ExampleFrame
from catoptra_studies.degradation.degradation_report import (
    failure_table,
    format_sweep_summary,
    write_degradation_results,
)
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.degradation_sweeps import DegradationSweep
from catoptra_studies.experiment.experiment_runner import ExperimentConfig

SWEEP = DegradationSweep(
    "Too dark", "no light", "light", {"0.5": "A=1|B=2", "0.1": "A=2"}, ini_keys="C=3"
)
EXAMPLE = ExampleFrame(np.zeros((4, 4, 3), np.uint8), (), (), (), (2.0, 2.0))


def make_metrics(num_detected: int, ekf_max_m: float) -> DegradationMetrics:
    error = 0.5 if num_detected else None
    return DegradationMetrics(200, 100, num_detected, 0.25, error, error, ekf_max_m, 0.05, 2.0)


RESULT = SweepResult(
    SWEEP,
    LevelResult("clean", {TRAINED_ON_CLEAN: make_metrics(100, 0.1)}, EXAMPLE),
    (
        LevelResult(
            "0.5",
            {TRAINED_ON_CLEAN: make_metrics(80, 0.3), TRAINED_ON_DEGRADED: make_metrics(100, 0.1)},
            EXAMPLE,
        ),
        LevelResult(
            "0.1",
            {TRAINED_ON_CLEAN: make_metrics(0, 2.0), TRAINED_ON_DEGRADED: make_metrics(60, 0.2)},
            EXAMPLE,
        ),
    ),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("degradation")
    config = ExperimentConfig(None, output, setups=(), num_runs=2, seed=7, num_training_frames=1)
    write_degradation_results(output, config, [RESULT])
    return output


def test_summary_has_levels_keys_and_failure_levels(folder: Path) -> None:
    summary = json.loads((folder / "degradation.json").read_text())
    assert (summary["version"], summary["num_runs"], summary["seed"]) == (2, 2, 7)
    (sweep,) = summary["sweeps"]
    assert sweep["ini_keys"] == ["C=3"]
    assert sweep["clean"]["rms_difference_grey_levels"] == 0.0
    assert [level["ini_keys"] for level in sweep["levels"]] == [["A=1", "B=2"], ["A=2"]]
    assert sweep["levels"][0]["trained_on"][TRAINED_ON_DEGRADED]["detection_rate"] == 1.0
    assert sweep["levels"][1]["trained_on"][TRAINED_ON_CLEAN]["bearing_rms_deg"] is None
    failure_levels = sweep["failure_levels"]
    assert list(failure_levels[TRAINED_ON_CLEAN].values()) == ["0.5", "0.1", "0.5", "0.1"]
    assert failure_levels[TRAINED_ON_DEGRADED]["detection_below_90_percent"] == "0.1"


def test_table_has_a_row_a_sweep_with_dashes_where_no_level_fails() -> None:
    *_, row = failure_table([RESULT]).splitlines()
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == ["Too dark", "light", "0.5 … 0.1", *("0.5", "0.1") * 2, "0.1", "–", "–"]


def test_report_has_every_level_of_every_sweep(folder: Path) -> None:
    report = (folder / "DEGRADATION.md").read_text(encoding="utf-8")
    rows = [" ".join(line.split()) for line in report.splitlines()]
    assert "2 drives of 100 frames" in report
    assert "\n## Too dark\n\nNo light.\n" in report
    clean = "| clean | 0.0 | 100% | 0.25 | 0.50° | 500 mm | 0.10 m | 0.05 m |"
    assert any(row.startswith(clean) for row in rows)
    assert "| 0.1 | 0.0 | 0% | 0.25 | – | – | 2.00 m | 0.05 m | 60% | 0.25 | 0.20 m |" in rows


def test_summary_for_the_page_has_conditions_and_every_level_of_a_sweep_in_a_row() -> None:
    text = format_sweep_summary([RESULT], num_runs=2, seed=7)
    conditions, table = text.split("\n\n")
    assert "Drives per level: 2 of 100 frames, seeds 7 to 8;" in conditions
    assert "Clean images: 100 % → 0.10 m; odometry alone: 2.00 m." in " ".join(conditions.split())
    assert table.splitlines()[2:] == [
        "| too dark: light | 0.5: 80 % → 0.30 m; 0.1: 0 % → **2.00 m** | 60 % → 0.20 m |"
    ]
