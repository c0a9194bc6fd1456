"""Frames and figures of the camera for the report, drawn here or by another program.

Where the server is not installed, as in the client's container, another program draws the figures
into the output folder. figures.json is written last and is the sign that all figures are there.

The paper's Figure 11 shows a recorded and a simulated image. No recorded image exists here: the
robot p2at_omni_real, which simulates what the paper says that real cameras suffer from, stands in.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import can_start_server, run_server
from catoptra_protocol.errors import CatoptraError
from catoptra_studies.experiment.drive_log import spawn_robot
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.reports import ReportFigure


@dataclass(frozen=True, slots=True)
class CameraFigures:
    """Drawn figures of the camera; without any, all is empty."""

    figures: tuple[ReportFigure, ...] = ()

    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Numbers of each figure, by file name without suffix."""

    timings: Mapping[str, Any] = field(default_factory=dict)
    """Measured times in the same form, which differ from run to run."""


_POLL_INTERVAL_S = 0.2


class FigureSource(Enum):
    """Program that draws the figures of the camera."""

    LOCAL = "local"
    EXTERNAL = "external"
    NONE = "none"


def default_figure_source() -> FigureSource:
    """LOCAL where a server is installed, otherwise NONE."""
    # With remote servers only, the report is complete but for the section on the camera.
    return FigureSource.LOCAL if can_start_server() else FigureSource.NONE


def collect_camera_figures(config: ExperimentConfig, source: FigureSource) -> CameraFigures:
    """Have the figures drawn into the output folder, or wait for another program's.

    Raises:
        CatoptraError: The figures could not be drawn, or did not appear within the timeout.
    """
    match source:
        case FigureSource.LOCAL:
            _draw_figures(config)
        case FigureSource.EXTERNAL:
            _wait_for_file(config.output_folder / "figures.json", timeout_s=config.timeout_s)
        case FigureSource.NONE:
            # The report then has an empty section, and summary.json no metrics of the camera.
            return CameraFigures()
    return _read_camera_figures(config.output_folder)


def _read_camera_figures(folder: Path) -> CameraFigures:
    """Read figures.json of a folder."""
    index = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    figures = tuple(
        ReportFigure(
            entry["file"],
            f"{entry['title']} (the paper's {entry['paper_reference']})",
            entry["caption"],
            entry["alt"],
        )
        for entry in index["figures"]
    )
    return CameraFigures(figures, index["metrics"], index["timings"])


def _draw_figures(config: ExperimentConfig) -> None:
    """Run `catoptra-studies figures` as a process, which may import the server."""
    # A process and no import: this package has to load where no server is installed.
    command = [
        *(sys.executable, "-m", "catoptra_studies", "figures"),
        *("--out", str(config.output_folder)),
        *("--robot", str(config.find_file("robots", "p2at_omni.ini"))),
        *("--world", str(config.field_world_file)),
        *("--rings-world", str(config.find_file("worlds", "incidence_rings.ini"))),
        *("--rooms-world", str(config.find_file("worlds", "corridors_and_rooms.ini"))),
    ]
    if subprocess.run(command, check=False).returncode != 0:
        raise CatoptraError("the figures of the camera could not be drawn: see the lines above")


def _wait_for_file(file: Path, *, timeout_s: float) -> None:
    deadline_s = time.monotonic() + timeout_s
    # An empty file is one that the other program has just opened.
    while not (file.is_file() and file.stat().st_size):
        if time.monotonic() >= deadline_s:
            raise CatoptraError(
                f"no figures of the camera: {file} did not appear within {timeout_s:g} s. Draw "
                "them with catoptra-studies figures, or leave them out: --figures none"
            )
        time.sleep(_POLL_INTERVAL_S)


_DEGRADED_ROBOT_FILE = "p2at_omni_real.ini"
# Near the first corner of the simulated drive.
_START = Waypoint(1.6, -1.2, 2.6)
# A turn to the left at about a radian a second, as an operator drives: visible as motion blur.
_WHEEL_SPEEDS_RAD_S = (-2.5, 2.5)
_DURATION_S = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class FrameComparison:
    """Two frames of one view."""

    degraded_rgb: UInt8Array
    """(h, w, 3) frame with the effects of a real camera."""

    clean_rgb: UInt8Array
    """(h, w, 3) frame of the simulated set-up."""


def capture_frame_comparison(config: ExperimentConfig) -> FrameComparison | None:
    """Capture both frames from servers that are started here; None where none is installed."""
    if not can_start_server():
        return None
    return FrameComparison(
        degraded_rgb=_capture_turning(config, _DEGRADED_ROBOT_FILE),
        clean_rgb=_capture_turning(config, SIM.robot_file),
    )


def _capture_turning(config: ExperimentConfig, robot_file: str) -> UInt8Array:
    """Frame of a robot that turns on the spot."""
    with (
        run_server(
            config.find_file("robots", robot_file),
            config.field_world_file,
            seed=config.seed,
            log_file=config.output_folder / "server_frames.log",
            extra_arguments=config.server_arguments,
        ) as address,
        RobotClient.connect(address.host, address.control_port) as robot,
        # The first frame with all effects takes a second, and many on a busy machine.
        ImageClient.connect(address.host, address.image_port, config.timeout_s) as images,
    ):
        spawn_robot(robot, _START, "Run0")
        robot.drive(*_WHEEL_SPEEDS_RAD_S)
        robot.step(_DURATION_S)
        return images.get_frame().rgb
