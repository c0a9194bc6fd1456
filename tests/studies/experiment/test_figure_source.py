"""The camera's pictures as others leave them: read, waited for, left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.figure_source import FigureSource, collect_camera_figures

DRAWN = {
    "figures": [
        {"file": "a.png", "title": "Faces", "figure": "Figure 5", "caption": "five", "alt": "f"}
    ],
    "numbers": {"eq2_px": 0.81},
}


@pytest.fixture
def plan(tmp_path: Path) -> ExperimentConfig:
    return ExperimentConfig(
        None,
        tmp_path,
        setups=(),
        num_runs=1,
        seed=0,
        num_training_frames=1,
        remote_servers={},
        timeout_s=0.0,
    )


def test_pictures_when_drawn_elsewhere_are_read(plan: ExperimentConfig) -> None:
    (plan.output_folder / "figures.json").write_text(json.dumps(DRAWN))
    pictures, numbers = collect_camera_figures(plan, FigureSource.EXTERNAL)
    assert [(p.file, p.title) for p in pictures] == [("a.png", "Faces (the paper's Figure 5)")]
    assert numbers == {"eq2_px": 0.81}


def test_pictures_when_nobody_draws_them_are_missed_with_a_remedy(plan: ExperimentConfig) -> None:
    with pytest.raises(CatoptraError, match="--pictures nobody"):
        collect_camera_figures(plan, FigureSource.EXTERNAL)


def test_pictures_when_left_out_are_none(plan: ExperimentConfig) -> None:
    assert collect_camera_figures(plan, FigureSource.NONE) == ([], {})


def test_pictures_when_they_cannot_be_drawn_here_are_an_error(
    plan: ExperimentConfig, tmp_path: Path
) -> None:
    with pytest.raises(CatoptraError, match="could not be drawn"):
        collect_camera_figures(replace(plan, config_folder=tmp_path), FigureSource.LOCAL)
