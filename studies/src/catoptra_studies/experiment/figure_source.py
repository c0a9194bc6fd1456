"""The camera's own pictures for the report: drawn by the server's command, or by someone else.

Where the server is not installed, as in the client's container, whoever has it draws them into the
output folder; figures.json is written last and says that they are there.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_report import ReportFigure

CameraFigures = tuple[list[ReportFigure], dict[str, Any]]

_POLL_INTERVAL_S = 0.2


class FigureSource(Enum):
    """Who draws the pictures of the camera."""

    LOCAL = "here"
    EXTERNAL = "elsewhere"
    NONE = "nobody"


def collect_camera_figures(config: ExperimentConfig, source: FigureSource) -> CameraFigures:
    """Return the pictures that are in the plan's output, and the numbers that go with them."""
    match source:
        case FigureSource.LOCAL:
            _draw_figures(config)
        case FigureSource.EXTERNAL:
            _wait_for_file(config.output_folder / "figures.json", timeout_s=config.timeout_s)
        case FigureSource.NONE:
            return [], {}
    return read_camera_figures(config.output_folder)


def read_camera_figures(folder: Path) -> CameraFigures:
    """Return what figures.json of a folder lists."""
    drawn = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    return [_report_figure(entry) for entry in drawn["figures"]], drawn["numbers"]


def _report_figure(entry: dict[str, str]) -> ReportFigure:
    title = f"{entry['title']} (the paper's {entry['figure']})"
    return ReportFigure(entry["file"], title, entry["caption"], entry["alt"])


def _draw_figures(config: ExperimentConfig) -> None:
    """Have the server's own command draw faces, cube, mirrors and comparisons."""
    command = [
        *(
            sys.executable,
            "-m",
            "catoptra_studies.camera_figures",
            "--output",
            str(config.output_folder),
        ),
        *(
            "--robot",
            str(config.robot_file("p2at_omni.ini")),
            "--world",
            str(config.field_world_file),
        ),
        *("--rings-world", str(config.world_file("incidence_rings.ini"))),
    ]
    if subprocess.run(command, check=False).returncode != 0:
        raise CatoptraError("the pictures of the camera could not be drawn: see the lines above")


def _wait_for_file(
    file: Path,
    *,
    timeout_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    deadline_s = clock() + timeout_s
    while not (file.is_file() and file.stat().st_size):
        if clock() >= deadline_s:
            raise CatoptraError(
                f"nobody drew the pictures of the camera: {file} did not come within "
                f"{timeout_s:g} s. Draw them with python -m catoptra_studies.camera_figures, or leave "
                "them out: --pictures nobody"
            )
        sleep(_POLL_INTERVAL_S)
