"""The pictures of the study: those of its numbers alone, and those that need frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from catoptra_server.render.renderer import Image
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.accuracy_levels import POLYGON_COUNTS
from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel
from catoptra_studies.accuracy_cost.plots import (
    detail_plot,
    frame_rate_plot,
    level_plot,
    localization_plot,
    pareto_plot,
    polygon_plot,
)
from catoptra_studies.study_subject import StudySubject, resize_camera
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX

# Of the exact detail beside the meshes' 2 x 2: smooth to the eye.
_EXACT_SAMPLES = 4


def write_result_plots(results: CostResults, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and landmarks.png where these were measured."""
    with plot_style.open_page(pareto_plot.WIDTH_PX, pareto_plot.HEIGHT_PX) as page:
        pareto_plot.draw(page, results.levels)
        plot_style.save_page(page, folder / "pareto.png")
    if results.frame_rates:
        with plot_style.open_page(frame_rate_plot.WIDTH_PX, frame_rate_plot.HEIGHT_PX) as page:
            frame_rate_plot.draw(page, results.frame_rates)
            plot_style.save_page(page, folder / "frame_rates.png")
    if results.localization:
        with plot_style.open_page(localization_plot.WIDTH_PX, localization_plot.HEIGHT_PX) as page:
            localization_plot.draw(page, results)
            plot_style.save_page(page, folder / "landmarks.png")


def write_frame_plots(
    subject: StudySubject, levels: Sequence[MeasuredLevel], reference: Image, folder: Path
) -> None:
    """Write steps.png, polygons.png and detail.png."""
    with plot_style.open_page(level_plot.WIDTH_PX, level_plot.HEIGHT_PX) as page:
        level_plot.draw(page, levels, reference, subject.camera.horizon_radius_px)
        plot_style.save_page(page, folder / "steps.png")
    camera = resize_camera(subject.camera, PAPER_SIZE_PX)
    paper_size = dataclasses.replace(
        subject, camera=camera, camera_states=subject.camera_states[:1]
    )
    frames = {
        count: polygon_plot.render_polygon_frame(paper_size, tessellation_from_polygon_count(count))
        for count in POLYGON_COUNTS
    }
    with plot_style.open_page(polygon_plot.WIDTH_PX, polygon_plot.HEIGHT_PX) as page:
        polygon_plot.draw(page, camera, frames)
        plot_style.save_page(page, folder / "polygons.png")
    with plot_style.open_page(detail_plot.WIDTH_PX, detail_plot.HEIGHT_PX) as page:
        (exact,) = paper_size.render_reference(_EXACT_SAMPLES)
        detail_plot.draw(page, frames, exact, max_radius_px=camera.horizon_radius_px)
        plot_style.save_page(page, folder / "detail.png")
