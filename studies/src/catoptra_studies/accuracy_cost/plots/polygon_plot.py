"""The paper's Figure 8 with error maps: the frame through four meshes, and the displacement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES
from catoptra_studies.camera_figures.polygon_figures import (
    DISPLACEMENT_RANGE_PX,
    colour_displacement,
    displacement_map,
)
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX
from catoptra_studies.plot_style import Image, draw_colour_bar
from catoptra_studies.study_subject import StudySubject

POLYGONS_HEIGHT_PX = 910
_TOP_PX = 56


def draw_polygon_frames(
    page: plot_style.Page, camera: OmniCamera, frames: Mapping[int, Image]
) -> None:
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
        colours = colour_displacement(error_px)
        plot_style.show_image(page, colours, left, _TOP_PX + PAPER_SIZE_PX + 14, PAPER_SIZE_PX)
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=POLYGONS_HEIGHT_PX - 84, width=480,
        ticks=(0.1, 1, 10, 100), title="below: displacement, px; grey: no polygon",
    )  # fmt: skip


def render_polygon_frame(subject: StudySubject, tessellation: Tessellation) -> Image:
    """Render the first pose through a mesh, by as many exact rays a pixel as a figure has."""
    settings = RenderSettings(tessellation, FIGURE_SAMPLES)
    view = subject.prepare_view(RendererKind.TRACE, settings)
    try:
        return view.render(subject.camera_states[0]).rgb
    finally:
        view.close()
