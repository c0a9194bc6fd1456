"""The command whole, with a tiny picture: what it writes, and what it says when it cannot."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from catoptra_studies.accuracy_cost.cost_command import EXIT_FAILURE, main
from catoptra_studies.accuracy_cost.cost_results import (
    CostResults,
    read_cost_results,
    write_cost_results,
)
from helpers.configs import FIELD, OMNI_ROBOT, REPOSITORY

FILES = ("--robot", str(OMNI_ROBOT), "--world", str(FIELD))
PICTURES = ("pareto.png", "steps.png", "polygons.png", "detail.png", "frame_rates.png")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    written = tmp_path_factory.mktemp("cost") / "made"
    assert main([*FILES, "--size", "64", "--quick", "--output", str(written)]) == 0
    return written


def test_study_has_the_key_steps_and_a_front(folder: Path) -> None:
    study = read_cost_results(folder / "cost.json")
    assert study.conditions.size_px == 64
    assert any(step.is_key and step.renderer == "trace" for step in study.levels)
    assert any(step.is_on_pareto_front for step in study.levels)
    assert len(study.polygon_rows) == 20
    assert study.localization is None


@pytest.mark.parametrize("name", PICTURES)
def test_picture_is_drawn(folder: Path, name: str) -> None:
    assert cv2.imread(str(folder / name)).std() > 10.0


def test_report_stands_beside_the_numbers(folder: Path) -> None:
    assert (folder / "COST.md").read_text().startswith("# What accuracy costs in time\n")


def test_telling_when_nothing_is_measured_writes_report_table_and_landmarks(
    document: CostResults, tmp_path: Path
) -> None:
    write_cost_results(document, tmp_path / "cost.json")
    readme = tmp_path / "README.md"
    readme.write_text("<!-- cost: begin -->\n<!-- cost: end -->\n")
    report = tmp_path / "elsewhere.md"
    places = ("--output", str(tmp_path), "--report", str(report), "--readme", str(readme))
    assert main([*FILES, *places, "--tell"]) == 0
    assert "a made-up machine" in report.read_text()
    assert "| exact, 2x2" in readme.read_text()
    assert (tmp_path / "landmarks.png").is_file()


def test_file_when_missing_ends_with_a_message_and_no_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--robot", str(tmp_path / "no.ini"), "--world", str(FIELD)]
    assert main([*arguments, "--output", str(tmp_path)]) == EXIT_FAILURE
    assert "no.ini" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["15", "4097"])
def test_size_when_out_of_reach_is_refused_with_usage(
    size: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*FILES, "--size", size])
    assert "a picture is 16 to 4096 px wide here" in capsys.readouterr().err


def test_readme_has_a_place_for_the_table() -> None:
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert "<!-- cost: begin" in text
    assert "<!-- cost: end -->" in text
