"""The command `catoptra-studies figures`: draw every figure of the table into a folder.

A new figure is a line in FIGURES and a function `draw_x(page, inputs) -> FigureCaption`, which
draws with `plot_style` and renders with `inputs` alone.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from catoptra_protocol.command_line import CommandParser
from catoptra_server.commands.explain import parse_pose
from catoptra_server.config.known_names import find_configuration
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
from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
)

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


def main(arguments: Sequence[str]) -> int:
    """Draw the figures."""
    parsed = parse_study(_make_parser(), arguments)
    with (
        open_figure_inputs(
            parsed.robot, parsed.world, parsed.rings_world, parsed.rooms_world, pose=parsed.pose
        ) as inputs,
        open_progress() as progress,
    ):
        write_figures(FIGURES, inputs, parsed.out, progress)
    print_line(f"{len(FIGURES)} figures in {parsed.out}")
    return 0


class _ReadPose(argparse.Action):
    """Read X,Y,YAW; three words with an angle in degrees are the form of earlier releases."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, words: Any, *_: object
    ) -> None:
        try:
            pose = parse_pose(",".join(words))
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentError(self, str(error)) from error
        is_old = len(words) > 1
        namespace.pose = replace(pose, yaw_rad=math.radians(pose.yaw_rad)) if is_old else pose


def _make_parser() -> CommandParser:
    parser = make_parser(
        "figures", "Draw the figures of the camera: frame, faces, cube, rings, mirror meshes."
    )
    add = parser.add_argument
    find_world = partial(find_configuration, "worlds")
    add("--robot", type=partial(find_configuration, "robots"), default="p2at_omni", metavar="FILE",
        help="robot ini with a camera, or a bundled name")  # fmt: skip
    add("--world", type=find_world, default="four_legged_2006", metavar="FILE",
        help="world ini or name")  # fmt: skip
    add("--rings-world", type=find_world, default="incidence_rings", metavar="FILE",
        help="world with a circle every 5 degrees")  # fmt: skip
    add("--rooms-world", type=find_world, default="corridors_and_rooms", metavar="FILE",
        help="second map of Figure 10")  # fmt: skip
    add_output(parser, "out/figures", "folder for the PNG files and figures.json")
    add("--pose", action=_ReadPose, nargs="+", metavar="X,Y,YAW",
        help="robot's pose, in metres and radians (default: near the first start)")  # fmt: skip
    return parser
