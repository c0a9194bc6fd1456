"""Plots of the study: some made of its numbers alone, others of frames rendered for them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel
from catoptra_studies.accuracy_cost.plots import (
    detail_plot,
    level_plot,
    localization_plot,
    pareto_plot,
    polygon_plot,
)
from catoptra_studies.camera_figures import frame_rate_figure
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES
from catoptra_studies.paper_values import PAPER_SIZE_PX, POLYGON_COUNTS
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject


def write_result_plots(results: CostResults, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and localization.png where these were measured."""
    with plot_style.open_page(pareto_plot.WIDTH_PX, pareto_plot.HEIGHT_PX) as page:
        pareto_plot.draw(page, results.levels)
        plot_style.save_page(page, folder / "pareto.png")
    if results.frame_rates:
        with plot_style.open_page(frame_rate_figure.WIDTH_PX, frame_rate_figure.HEIGHT_PX) as page:
            frame_rate_figure.draw_panels(page, results.frame_rates)
            plot_style.save_page(page, folder / "frame_rates.png")
    if results.localization:
        with plot_style.open_page(localization_plot.WIDTH_PX, localization_plot.HEIGHT_PX) as page:
            localization_plot.draw(page, results.localization)
            plot_style.save_page(page, folder / "localization.png")


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
    with plot_style.open_page(level_plot.WIDTH_PX, level_plot.HEIGHT_PX) as page:
        level_plot.draw(page, levels, reference, subject.camera.horizon_radius_px)
        plot_style.save_page(page, folder / "levels.png")
    # The paper's figures have the paper's size, of whatever size the study is.
    paper_size = dataclasses.replace(
        subject,
        camera=subject.resize_camera(PAPER_SIZE_PX),
        camera_states=subject.camera_states[:1],
    )
    # 4096 polygons are for detail.png alone; polygons.png ends with the paper's 1024.
    frames = {
        count: polygon_plot.render_polygon_frame(paper_size, tessellation_from_polygon_count(count))
        for count in POLYGON_COUNTS
    }
    with plot_style.open_page(polygon_plot.WIDTH_PX, polygon_plot.HEIGHT_PX) as page:
        polygon_plot.draw(page, paper_size.camera, frames)
        plot_style.save_page(page, folder / "polygons.png")
    with plot_style.open_page(detail_plot.WIDTH_PX, detail_plot.HEIGHT_PX) as page:
        (exact,) = paper_size.render_reference(FIGURE_SAMPLES)
        radius_px = paper_size.camera.horizon_radius_px
        detail_plot.draw(page, frames, exact, max_radius_px=radius_px)
        plot_style.save_page(page, folder / "detail.png")
