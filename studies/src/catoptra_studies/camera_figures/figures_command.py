"""The command `catoptra-studies figures`: draw every figure of the table into a folder.

A new figure is a line in FIGURES and a function `draw_x(page, inputs) -> FigureCaption`, which
draws with `plot_style` and renders with `inputs` alone.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from catoptra_server.config.known_names import find_configuration
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_studies.camera_figures.figure_spec import (
    FigureSpec,
    open_figure_inputs,
    write_figures,
)
from catoptra_studies.camera_figures.frame_rates import draw_frame_rates
from catoptra_studies.camera_figures.image_figures import draw_faces, draw_omni_frame
from catoptra_studies.camera_figures.polygon_figures import (
    draw_polygon_detail,
    draw_polygon_error,
    draw_polygon_frames,
    draw_polygon_maps,
)
from catoptra_studies.camera_figures.radius_figures import draw_eq2, draw_rings
from catoptra_studies.camera_figures.space_figures import draw_cube, draw_meshes
from catoptra_studies.camera_figures.viewpoint_figure import draw_viewpoint
from catoptra_studies.commands import add_output, make_parser, open_progress, print_line, run_study

# In the order of the report; the column is PAGE_WIDTH_PX wide at five eighths of the pixels.
FIGURES = (
    FigureSpec("omni_frame.png", "Figure 1", 1160, 1130, draw_omni_frame),
    FigureSpec("viewpoint.png", "Figure 2", 1520, 800, draw_viewpoint),
    FigureSpec("faces.png", "Figure 5", 1520, 780, draw_faces),
    FigureSpec("cube.png", "Figures 4 and 6", 1520, 1120, draw_cube),
    FigureSpec("rings.png", "Figure 7", 1520, 800, draw_rings),
    FigureSpec("eq2.png", "Equation 2", 1520, 640, draw_eq2),
    FigureSpec("meshes.png", "Figure 3", 1520, 620, draw_meshes),
    FigureSpec("polygons.png", "Figure 8", 1520, 1600, draw_polygon_frames),
    FigureSpec("polygon_detail.png", "Figure 9", 1520, 440, draw_polygon_detail),
    FigureSpec("polygon_maps.png", "Figure 8", 1520, 540, draw_polygon_maps),
    FigureSpec("polygon_error.png", "Section 3.1", 1520, 760, draw_polygon_error),
    FigureSpec("frame_rates.png", "Figure 10", 1520, 690, draw_frame_rates),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the figures; return 0, or 2 after one line about the reason."""
    return run_study("catoptra-studies figures", _make_parser().parse_args(arguments), _run)


def _run(parsed: argparse.Namespace) -> int:
    robot_file = find_configuration("robots", parsed.robot)
    world_file = find_configuration("worlds", parsed.world)
    rings_file = find_configuration("worlds", parsed.rings_world)
    rooms_file = find_configuration("worlds", parsed.rooms_world)
    with (
        open_figure_inputs(
            robot_file, world_file, rings_file, rooms_file, pose=_planar_pose(parsed.pose)
        ) as inputs,
        open_progress() as progress,
    ):
        write_figures(FIGURES, inputs, parsed.output, progress)
    print_line(f"{len(FIGURES)} figures in {parsed.output}")
    return 0


def _planar_pose(numbers: Sequence[float] | None) -> PlanarPose | None:
    if numbers is None:
        return None
    x_m, y_m, yaw_deg = numbers
    return PlanarPose(x_m, y_m, math.radians(yaw_deg))


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser(
        "figures", "Draw the figures of the camera: frame, faces, cube, rings, mirror meshes."
    )
    add = parser.add_argument
    add("--robot", default="p2at_omni", metavar="FILE",
        help="robot ini with a camera, or a bundled name (default p2at_omni)")  # fmt: skip
    add("--world", default="four_legged_2006", metavar="FILE",
        help="world ini or name (default four_legged_2006)")  # fmt: skip
    add("--rings-world", default="incidence_rings", metavar="FILE",
        help="world with a circle every 5 degrees (default incidence_rings)")  # fmt: skip
    add("--rooms-world", default="corridors_and_rooms", metavar="FILE",
        help="second map of Figure 10 (default corridors_and_rooms)")  # fmt: skip
    add_output(parser, "out/figures", "folder for the PNG files and figures.json")
    add("--pose", type=float, nargs=3, metavar=("X", "Y", "YAW_DEG"),
        help="robot's pose: metres, degrees clockwise (default: near the first start)")  # fmt: skip
    return parser
