"""Where mirror meshes displace the image, pixel by pixel: maps beside the paper's Figure 8."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs, Metrics
from catoptra_studies.camera_figures.polygon_displacement import displacement_map
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX
from catoptra_studies.plot_style import Image, draw_colour_bar, map_error_colours

DISPLACEMENT_RANGE_PX = (0.1, 100.0)
# White would look like no error where no polygon is.
_EMPTY_GREY = 226
_LEFT_PX, _TOP_PX, _STEP_PX = 10, 56, PAPER_SIZE_PX + 20


def draw_polygon_maps(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the displacement of each pixel by four meshes, with one colour scale."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    below_1px: Metrics = {}
    for index, count in enumerate(PAPER_POLYGON_COUNTS):
        left = _LEFT_PX + index * _STEP_PX
        error_px = displacement_map(camera, tessellation_from_polygon_count(count))
        plot_style.add_text(
            page, left, _TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold"
        )
        plot_style.show_image(page, colour_displacement(error_px), left, _TOP_PX, PAPER_SIZE_PX)
        covered = error_px[~np.isnan(error_px)]
        below_1px[f"below_1px_{count}_percent"] = round(100.0 * float((covered < 1.0).mean()), 1)
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=_TOP_PX + PAPER_SIZE_PX + 30, width=480,
        ticks=(0.1, 1, 10, 100), title="displacement, px; grey: no polygon",
    )  # fmt: skip
    return _caption(below_1px)


def colour_displacement(error_px: Floats) -> Image:
    """(h, w, 3) colours of a map of displacements, grey where it is nan."""
    colours = map_error_colours(np.nan_to_num(error_px), *DISPLACEMENT_RANGE_PX)
    colours[np.isnan(error_px)] = _EMPTY_GREY
    return colours


def _caption(metrics: Metrics) -> FigureCaption:
    coarse, fine = PAPER_POLYGON_COUNTS[0], PAPER_POLYGON_COUNTS[-1]
    return FigureCaption(
        title="Where the meshes displace the image",
        caption=(
            "The same meshes: how far the content of each pixel is from its place in the exact "
            "image. Corners of polygons are right, their middles are not. Displaced by "
            f"less than a pixel are {metrics[f'below_1px_{coarse}_percent']:.1f} % of the pixels "
            f"with {coarse} polygons and {metrics[f'below_1px_{fine}_percent']:.1f} % with {fine}."
        ),
        alt=(
            "Four round maps of errors from dark red with 16 polygons to almost white with 1024; "
            "the pattern of the polygons shows in each."
        ),
        metrics=metrics,
    )
