"""Figures of the camera: drawn here, read from another program, left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.figure_source import (
    CameraFigures,
    FigureSource,
    collect_camera_figures,
)

INDEX = {
    "figures": [
        {
            "file": "a.png",
            "title": "Faces",
            "paper_reference": "Figure 5",
            "caption": "five",
            "alt": "f",
        }
    ],
    "metrics": {"eq2_px": 0.81},
    "timings": {"frame_rates": {"16": 9.5}},
}


@pytest.fixture
def config(tmp_path: Path) -> ExperimentConfig:
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


def test_figures_when_external_are_read(config: ExperimentConfig) -> None:
    (config.output_folder / "figures.json").write_text(json.dumps(INDEX))
    found = collect_camera_figures(config, FigureSource.EXTERNAL)
    assert [(p.file, p.title) for p in found.figures] == [("a.png", "Faces (the paper's Figure 5)")]
    assert (found.metrics, found.timings) == ({"eq2_px": 0.81}, {"frame_rates": {"16": 9.5}})


def test_figures_when_they_do_not_appear_are_reported_with_a_remedy(
    config: ExperimentConfig,
) -> None:
    with pytest.raises(CatoptraError, match="--figures none"):
        collect_camera_figures(config, FigureSource.EXTERNAL)


def test_figures_when_left_out_are_none(config: ExperimentConfig) -> None:
    assert collect_camera_figures(config, FigureSource.NONE) == CameraFigures()


def test_figures_when_they_cannot_be_drawn_raise(config: ExperimentConfig, tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="could not be drawn"):
        collect_camera_figures(replace(config, config_folder=tmp_path), FigureSource.LOCAL)
