"""Plots of rendered frames: levels of the front, and the paper's Figures 8 and 9 with errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel
from catoptra_studies.accuracy_cost.plots.detail_plot import (
    DETAIL_HEIGHT_PX,
    draw_polygon_detail,
)
from catoptra_studies.accuracy_cost.plots.level_plot import (
    LEVELS_HEIGHT_PX,
    draw_level_details,
)
from catoptra_studies.accuracy_cost.plots.polygon_plot import (
    POLYGONS_HEIGHT_PX,
    draw_polygon_frames,
    render_polygon_frame,
)
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES
from catoptra_studies.paper_values import PAPER_SIZE_PX, POLYGON_COUNTS
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject


def write_frame_plots(
    subject: StudySubject, levels: Sequence[MeasuredLevel], reference: Image, folder: Path
) -> None:
    """Write levels.png, polygons.png and detail.png.

    Args:
        subject: Camera and renderers for the frames of polygons.png and detail.png.
        levels: Measured levels with their frames.
        reference: Exact frame at the first pose.
        folder: Folder for the plots.
    """
    with plot_style.open_page(folder / "levels.png", LEVELS_HEIGHT_PX) as page:
        draw_level_details(page, levels, reference, subject.camera.horizon_radius_px)
    # The paper's figures have the paper's size, of whatever size the study is.
    paper_size = dataclasses.replace(
        subject,
        camera=subject.resize_camera(PAPER_SIZE_PX),
        camera_states=subject.camera_states[:1],
    )
    # 4096 polygons are for detail.png alone; polygons.png ends with the paper's 1024.
    frames = {
        count: render_polygon_frame(paper_size, tessellation_from_polygon_count(count))
        for count in POLYGON_COUNTS
    }
    with plot_style.open_page(folder / "polygons.png", POLYGONS_HEIGHT_PX) as page:
        draw_polygon_frames(page, paper_size.camera, frames)
    with plot_style.open_page(folder / "detail.png", DETAIL_HEIGHT_PX) as page:
        (exact,) = paper_size.render_reference(FIGURE_SAMPLES)
        radius_px = paper_size.camera.horizon_radius_px
        draw_polygon_detail(page, frames, exact, max_radius_px=radius_px)
