"""The command `python -m catoptra_studies.camera_figures`: every figure of the table, into a folder.

To add a figure: write `<name>.py` beside the others with `draw(page, subject) -> Caption`, using
only `style` to draw and only `subject` to render, then add its line to FIGURES.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_studies.camera_figures import (
    cube_figure,
    eq2_figure,
    face_figure,
    mesh_figure,
    omni_frame_figure,
    polygon_detail_figure,
    polygon_error_figure,
    polygon_frames_figure,
    ring_figure,
)
from catoptra_studies.camera_figures.figure_spec import FigureSpec, write_figure, write_figure_index
from catoptra_studies.camera_figures.figure_subject import FigureSubject, open_figure_subject

EXIT_FAILURE = 2

FIGURES = (
    FigureSpec("omni_frame.png", "Figure 1", 1160, 1130, omni_frame_figure.draw),
    FigureSpec("faces.png", "Figure 5", 1520, 780, face_figure.draw),
    FigureSpec("cube.png", "Figures 4 and 6", 1520, 1120, cube_figure.draw),
    FigureSpec("rings.png", "Figure 7", 1520, 800, ring_figure.draw),
    FigureSpec("eq2.png", "Equation 2", 1520, 640, eq2_figure.draw),
    FigureSpec("meshes.png", "Figure 3", 1520, 620, mesh_figure.draw),
    FigureSpec("polygons.png", "Figure 8", 1520, 1600, polygon_frames_figure.draw),
    FigureSpec("polygon_detail.png", "Figure 9", 1520, 440, polygon_detail_figure.draw),
    FigureSpec("polygon_error.png", "Section 3.1", 1520, 760, polygon_error_figure.draw),
)


def write_figures(subject: FigureSubject, folder: Path, progress: Progress) -> None:
    """Write all figures and figures.json into a folder, which is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    task = progress.add_task("figures", total=len(FIGURES))
    captions = {}
    for figure in FIGURES:
        progress.update(task, description=figure.file)
        captions[figure] = write_figure(figure, subject, folder)
        progress.advance(task)
    progress.update(task, description="figures")
    write_figure_index(captions, folder)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the figures; return 0, or 2 with a message if they could not be drawn."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        robot = find_configuration("robots", parsed.robot)
        worlds = [find_configuration("worlds", name) for name in (parsed.world, parsed.rings_world)]
        with (
            open_figure_subject(robot, *worlds, pose=_planar_pose(parsed.pose)) as subject,
            _progress(console) as progress,
        ):
            write_figures(subject, parsed.output, progress)
    except (CatoptraError, OSError) as error:
        console.print(f"catoptra figures: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_FAILURE
    console.print(f"{len(FIGURES)} figures in {parsed.output}", markup=False, highlight=False)
    return 0


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def _planar_pose(numbers: Sequence[float] | None) -> PlanarPose | None:
    if numbers is None:
        return None
    x_m, y_m, yaw_deg = numbers
    return PlanarPose(x_m, y_m, math.radians(yaw_deg))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_studies.camera_figures",
        description="Draw the figures of the camera: frame, faces, cube, rings, polygon mirrors.",
    )
    add = parser.add_argument
    add("--robot", required=True, metavar="FILE", help="robot ini with a camera, or its name")
    add("--world", required=True, metavar="FILE", help="world ini to be pictured, or its name")
    add("--rings-world", default="incidence_rings", metavar="FILE",
        help="world with a line every 5 degrees of incidence (default: ours)")  # fmt: skip
    add("--output", type=Path, required=True, metavar="DIR", help="where the PNG files go")
    add("--pose", type=float, nargs=3, metavar=("X", "Y", "YAW_DEG"),
        help="robot: metres, degrees clockwise; default: beside the first start")  # fmt: skip
    return parser


if __name__ == "__main__":
    sys.exit(main())
