"""The whole command with a tiny image: its files, and its messages where it fails."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from catoptra_studies.accuracy_cost import frame_plots
from catoptra_studies.accuracy_cost.cost_command import main
from catoptra_studies.accuracy_cost.cost_results import (
    CostResults,
    read_cost_results,
    write_cost_results,
)
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig
from catoptra_studies.cli import main as run_study
from helpers.configs import FIELD, OMNI_ROBOT, REPOSITORY

FILES = ("--robot", str(OMNI_ROBOT), "--world", str(FIELD))
PLOTS = ("pareto.png", "levels.png", "polygons.png", "detail.png", "frame_rates.png")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("cost") / "new"
    arguments = ("--size", "64", "--quick", "--no-drives", "--out", str(output))
    with pytest.MonkeyPatch.context() as patch:
        # Figures of the paper's size with one ray a pixel: no test here looks at their edges.
        patch.setattr(frame_plots, "FIGURE_SAMPLES", 1)
        # Nor at the times, or at how near the reference is.
        patch.setattr(CostStudyConfig, "num_rounds", 1)
        patch.setattr(CostStudyConfig, "reference_samples", 6)
        assert main([*FILES, *arguments]) == 0
    return output


def test_results_when_measured_have_key_levels_and_a_front(folder: Path) -> None:
    results = read_cost_results(folder / "cost.json")
    assert results.conditions.size_px == 64
    assert any(level.is_key and level.renderer == "trace" for level in results.levels)
    assert any(level.is_on_pareto_front for level in results.levels)
    assert len(results.polygon_rows) == 20
    assert results.localization is None


@pytest.mark.parametrize("name", PLOTS)
def test_plot_when_measured_is_drawn(folder: Path, name: str) -> None:
    assert cv2.imread(str(folder / name)).std() > 10.0


def test_report_when_measured_is_beside_cost_json(folder: Path) -> None:
    assert (folder / "COST.md").read_text().startswith("# What accuracy costs in time\n")


def test_command_when_report_only_writes_report_table_and_localization_plot(
    results: CostResults, tmp_path: Path
) -> None:
    write_cost_results(results, tmp_path / "cost.json")
    readme = tmp_path / "README.md"
    readme.write_text("<!-- cost: begin -->\n<!-- cost: end -->\n")
    report = tmp_path / "elsewhere.md"
    paths = ("--out", str(tmp_path), "--report", str(report), "--page", str(readme))
    assert main([*FILES, *paths, "--report-only"]) == 0
    assert "a made-up machine" in report.read_text()
    assert "| exact, 2x2" in readme.read_text()
    assert (tmp_path / "localization.png").is_file()


def test_robot_file_when_missing_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--robot", str(tmp_path / "no.ini"), "--world", str(FIELD)]
    assert run_study(["cost", *arguments, "--out", str(tmp_path)]) == 1
    assert "no.ini" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["15", "4097"])
def test_size_when_out_of_range_is_rejected_with_usage(
    size: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*FILES, "--size", size])
    assert "a size is 16 to 4096" in capsys.readouterr().err


def test_readme_has_the_marks_of_the_table() -> None:
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert "<!-- cost: begin" in text
    assert "<!-- cost: end -->" in text
