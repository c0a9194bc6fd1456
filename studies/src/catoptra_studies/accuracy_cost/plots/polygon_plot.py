"""The paper's Figure 8 with error maps: the frame through four meshes, and the displacement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_sample_positions
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.error_colour_map import map_error_colours
from catoptra_studies.accuracy_cost.plots.plot_legend import draw_colour_bar
from catoptra_studies.camera_figures.polygon_displacement import displacement_px
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject

WIDTH_PX, HEIGHT_PX = 1520, 910
_TOP_PX = 56
DISPLACEMENT_RANGE_PX = (0.1, 100.0)
_EMPTY_GREY = 226


def draw(page: plot_style.Page, camera: OmniCamera, frames: Mapping[int, Image]) -> None:
    """Draw frames above displacement maps.

    Args:
        page: Page to draw on.
        camera: Camera of the paper's image size.
        frames: Frames of that size by number of polygons.
    """
    for index, count in enumerate(PAPER_POLYGON_COUNTS):
        left = 10 + index * (PAPER_SIZE_PX + 20)
        error_px = displacement_map(camera, tessellation_from_polygon_count(count))
        rms_px = float(np.sqrt(np.nanmean(np.square(error_px))))
        plot_style.add_text(
            page, left, _TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold"
        )
        plot_style.add_text(
            page, left + PAPER_SIZE_PX, _TOP_PX - 10, f"{rms_px:.3g} px rms", ha="right",
            va="bottom", fontsize=7, color=plot_style.MUTED,
        )  # fmt: skip
        plot_style.show_image(page, frames[count], left, _TOP_PX, PAPER_SIZE_PX)
        colours = map_error_colours(np.nan_to_num(error_px), *DISPLACEMENT_RANGE_PX)
        # White would look like no error where no polygon is.
        colours[np.isnan(error_px)] = _EMPTY_GREY
        plot_style.show_image(page, colours, left, _TOP_PX + PAPER_SIZE_PX + 14, PAPER_SIZE_PX)
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=HEIGHT_PX - 84, width=480,
        ticks=(0.1, 1, 10, 100), title="below: displacement, px; grey: no polygon",
    )  # fmt: skip


def render_polygon_frame(subject: StudySubject, tessellation: Tessellation) -> Image:
    """Render the first pose through a mesh, by 2 x 2 exact rays a pixel."""
    settings = RenderSettings(tessellation, 2)
    view = subject.prepare_view(RendererKind.TRACE, settings)
    try:
        return view.render(subject.camera_states[0]).rgb
    finally:
        view.close()


def displacement_map(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """(h, w) displacement of each pixel's content in pixels; nan where no polygon is."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, is_valid = displacement_px(camera, pixels, directions)
    return np.where(is_covered & is_valid, error_px, np.nan)
