"""The paper's Figure 8 with error maps: the frame through four meshes, and how far each is off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_sample_positions
from catoptra_server.render.render_plan import RendererKind, RenderSettings
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.scene.mirror_mesh import Tessellation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel
from catoptra_studies.accuracy_cost.error_colour_map import map_error_colours
from catoptra_studies.accuracy_cost.plots.plot_legend import draw_colour_bar
from catoptra_studies.study_subject import StudySubject
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX
from catoptra_studies.camera_figures.polygon_displacement import displacement_px

POLYGON_COUNTS = (16, 64, 256, 1024)
WIDTH_PX, HEIGHT_PX = 1520, 910
_TOP_PX = 56
DISPLACEMENT_RANGE_PX = (0.1, 100.0)


def draw(page: plot_style.Page, camera: OmniCamera, frames: Mapping[int, Image]) -> None:
    """Draw frames, by polygons, above displacement maps, all of the paper's size."""
    for index, count in enumerate(POLYGON_COUNTS):
        left = 10 + index * (PAPER_SIZE_PX + 20)
        error = displacement_map(camera, tessellation_from_polygon_count(count))
        rms = float(np.sqrt(np.nanmean(np.square(error))))
        plot_style.add_text(
            page, left, _TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold"
        )
        plot_style.add_text(page, left + PAPER_SIZE_PX, _TOP_PX - 10, f"{rms:.3g} px rms", ha="right",
                    va="bottom", fontsize=7, color=plot_style.MUTED)  # fmt: skip
        plot_style.show_image(page, frames[count], left, _TOP_PX, PAPER_SIZE_PX)
        colours = map_error_colours(np.nan_to_num(error), *DISPLACEMENT_RANGE_PX)
        colours[np.isnan(error)] = 226
        plot_style.show_image(page, colours, left, _TOP_PX + PAPER_SIZE_PX + 14, PAPER_SIZE_PX)
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=HEIGHT_PX - 84, width=480, ticks=(0.1, 1, 10, 100),
        title="below: displacement, px; grey: nothing is shown",
    )  # fmt: skip


def render_polygon_frame(subject: StudySubject, tessellation: Tessellation) -> Image:
    """Return the first exposure's frame through a mesh, 2 x 2 exact rays a pixel."""
    view = subject.prepare_view(
        AccuracyLevel("", RendererKind.TRACE, RenderSettings(tessellation, 2))
    )
    try:
        return view.render(subject.camera_states[0]).rgb
    finally:
        view.close()


def displacement_map(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """Return (h, w) px from where each pixel's content belongs; NaN where no polygon is."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, known = displacement_px(camera, pixels, directions)
    return np.where(covered & known, error_px, np.nan)
