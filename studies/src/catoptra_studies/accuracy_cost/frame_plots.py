"""Plots of rendered frames: levels of the front, and the paper's Figures 8 and 9 with errors.

Levels of the Pareto front: the same detail of the frame, and the error of its greys.

The paper's Figure 9 with error maps: facets that show at 256 polygons and hardly at 1024.

The paper's Figure 8 with error maps: the frame through four meshes, and the displacement.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel, signed_difference
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES
from catoptra_studies.camera_figures.polygon_figures import (
    DISPLACEMENT_RANGE_PX,
    colour_displacement,
    displacement_map,
    find_max_difference_window,
)
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX, POLYGON_COUNTS
from catoptra_studies.plot_style import Image, draw_colour_bar, map_error_colours
from catoptra_studies.study_subject import StudySubject

MAX_COLUMNS = 6
_LEVEL_CROP_PX, _ZOOM = 60, 4
_SIDE_PX, _GAP_PX, _TOP_PX = _LEVEL_CROP_PX * _ZOOM, 10, 100
_LEVELS_HEIGHT_PX = _TOP_PX + 2 * _SIDE_PX + 120
_GREY_LEVEL_RANGE = (1.0, 128.0)


def _draw_level_details(
    page: plot_style.Page,
    levels: Sequence[MeasuredLevel],
    reference: Image,
    horizon_radius_px: float,
) -> None:
    """Draw a column for each level of the front, from fast to exact.

    Args:
        page: Page to draw on.
        levels: All measured levels.
        reference: Exact frame at the pose of the levels' frames.
        horizon_radius_px: Radius within which the detail is searched.
    """
    front = select_front_levels(levels)
    # Tests run at 64 px, where the whole detail would not fit within the horizon.
    size_px = min(_LEVEL_CROP_PX, reference.shape[0] // 3)
    # The detail where the fastest level is worst shows best how the others improve.
    row, column = find_max_difference_window(
        front[0].frame, reference, size_px, max_radius_px=horizon_radius_px
    )
    window = slice(row, row + size_px), slice(column, column + size_px)
    for index, level in enumerate(front):
        left = 15 + index * (_SIDE_PX + _GAP_PX)
        _draw_heading(page, level, left)
        plot_style.show_image(page, level.frame[window], left, _TOP_PX, _SIDE_PX)
        error = np.abs(signed_difference(level.frame[window], reference[window])).max(axis=-1)
        colours = map_error_colours(error, *_GREY_LEVEL_RANGE)
        plot_style.draw_border(
            plot_style.show_image(page, colours, left, _TOP_PX + _SIDE_PX + 8, _SIDE_PX)
        )
    draw_colour_bar(
        page, _GREY_LEVEL_RANGE, left=820, top=_LEVELS_HEIGHT_PX - 84, width=480,
        ticks=(1, 4, 16, 64, 128), title="below: difference from the reference, grey levels",
    )  # fmt: skip


def select_front_levels(levels: Sequence[MeasuredLevel]) -> list[MeasuredLevel]:
    """Levels of the front from fast to exact, thinned evenly to MAX_COLUMNS with both ends."""
    front = sorted(
        (level for level in levels if level.cost.is_on_pareto_front),
        key=lambda level: level.cost.wall_ms,
    )
    # Rounded positions keep both ends and never repeat a level.
    chosen = np.linspace(0, len(front) - 1, min(len(front), MAX_COLUMNS)).round().astype(int)
    return [front[index] for index in chosen]


def _draw_heading(page: plot_style.Page, level: MeasuredLevel, left: int) -> None:
    surface, _, samples = level.cost.name.partition(", ")
    plot_style.add_text(page, left, 12, surface, fontweight="bold", fontsize=7.5)
    plot_style.add_text(page, left, 39, samples, fontsize=7.5)
    numbers = f"{level.cost.wall_ms:.1f} ms, RMSE {level.cost.rmse:.2g}"
    plot_style.add_text(page, left, 66, numbers, fontsize=7.5, color=plot_style.MUTED)


_POLYGON_COUNTS = (256, 1024, 4096)
_CROP_PX, _ZOOM_DETAIL_PLOT = 44, 8
_SIDE_PX_DETAIL_PLOT, _TOP_PX_DETAIL_PLOT = _CROP_PX * _ZOOM_DETAIL_PLOT, 56
_DETAIL_HEIGHT_PX = _TOP_PX_DETAIL_PLOT + 2 * _SIDE_PX_DETAIL_PLOT + 130
# Below one grey level nothing is visible; half of full contrast is as bad as an error can look.
_GREY_LEVEL_RANGE = (1.0, 128.0)


def _draw_polygon_detail(
    page: plot_style.Page, frames: Mapping[int, Image], exact: Image, *, max_radius_px: float
) -> None:
    """Draw the detail through three meshes and exactly, with the differences below.

    Args:
        page: Page to draw on.
        frames: Frames of the paper's size by number of polygons.
        exact: Frame of the exact mirror.
        max_radius_px: Radius of the horizon; the detail is searched within, where the floor's
            straight lines are.
    """
    coarsest = frames[_POLYGON_COUNTS[0]]
    row, column = find_max_difference_window(coarsest, exact, _CROP_PX, max_radius_px=max_radius_px)
    window = slice(row, row + _CROP_PX), slice(column, column + _CROP_PX)
    for index, count in enumerate(_POLYGON_COUNTS):
        detail = frames[count][window]
        left = 10 + index * (_SIDE_PX_DETAIL_PLOT + 22)
        _draw_column(page, f"{count} polygons", detail, left)
        error = np.abs(signed_difference(detail, exact[window])).max(axis=-1)
        colours = map_error_colours(error, *_GREY_LEVEL_RANGE)
        plot_style.draw_border(
            plot_style.show_image(
                page,
                colours,
                left,
                _TOP_PX_DETAIL_PLOT + _SIDE_PX_DETAIL_PLOT + 14,
                _SIDE_PX_DETAIL_PLOT,
            )
        )
    last = 10 + len(_POLYGON_COUNTS) * (_SIDE_PX_DETAIL_PLOT + 22)
    _draw_column(page, "exact mirror", exact[window], last)
    _draw_location(page, exact, (row, column), last)
    draw_colour_bar(
        page, _GREY_LEVEL_RANGE, left=820, top=_DETAIL_HEIGHT_PX - 84, width=480,
        ticks=(1, 4, 16, 64, 128), title="below: difference from the exact mirror, grey levels",
    )  # fmt: skip


def _draw_column(page: plot_style.Page, name: str, detail: Image, left: int) -> None:
    plot_style.add_text(page, left, _TOP_PX_DETAIL_PLOT - 10, name, va="bottom", fontweight="bold")
    plot_style.show_image(page, detail, left, _TOP_PX_DETAIL_PLOT, _SIDE_PX_DETAIL_PLOT)


def _draw_location(page: plot_style.Page, exact: Image, corner: tuple[int, int], left: int) -> None:
    """Show the whole frame with a square around the detail."""
    axes = plot_style.show_image(
        page, exact, left, _TOP_PX_DETAIL_PLOT + _SIDE_PX_DETAIL_PLOT + 14, _SIDE_PX_DETAIL_PLOT
    )
    v, u = corner
    axes.plot(
        [u, u + _CROP_PX, u + _CROP_PX, u, u], [v, v, v + _CROP_PX, v + _CROP_PX, v],
        color=plot_style.RED,
    )  # fmt: skip


_POLYGONS_HEIGHT_PX = 910
_TOP_PX_POLYGON_PLOT = 56


def _draw_polygon_frames(
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
            page,
            left,
            _TOP_PX_POLYGON_PLOT - 10,
            f"{count} polygons",
            va="bottom",
            fontweight="bold",
        )
        plot_style.add_text(
            page, left + PAPER_SIZE_PX, _TOP_PX_POLYGON_PLOT - 10, f"{rms_px:.3g} px rms",
            ha="right", va="bottom", fontsize=7, color=plot_style.MUTED,
        )  # fmt: skip
        plot_style.show_image(page, frames[count], left, _TOP_PX_POLYGON_PLOT, PAPER_SIZE_PX)
        colours = colour_displacement(error_px)
        plot_style.show_image(
            page, colours, left, _TOP_PX_POLYGON_PLOT + PAPER_SIZE_PX + 14, PAPER_SIZE_PX
        )
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=_POLYGONS_HEIGHT_PX - 84, width=480,
        ticks=(0.1, 1, 10, 100), title="below: displacement, px; grey: no polygon",
    )  # fmt: skip


def _render_polygon_frame(subject: StudySubject, tessellation: Tessellation) -> Image:
    """Render the first pose through a mesh, by as many exact rays a pixel as a figure has."""
    settings = RenderSettings(tessellation, FIGURE_SAMPLES)
    view = subject.prepare_view(RendererKind.TRACE, settings)
    try:
        return view.render(subject.camera_states[0]).rgb
    finally:
        view.close()


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
    with plot_style.open_page(folder / "levels.png", _LEVELS_HEIGHT_PX) as page:
        _draw_level_details(page, levels, reference, subject.camera.horizon_radius_px)
    # The paper's figures have the paper's size, of whatever size the study is.
    paper_size = dataclasses.replace(
        subject,
        camera=subject.resize_camera(PAPER_SIZE_PX),
        camera_states=subject.camera_states[:1],
    )
    # 4096 polygons are for detail.png alone; polygons.png ends with the paper's 1024.
    frames = {
        count: _render_polygon_frame(paper_size, tessellation_from_polygon_count(count))
        for count in POLYGON_COUNTS
    }
    with plot_style.open_page(folder / "polygons.png", _POLYGONS_HEIGHT_PX) as page:
        _draw_polygon_frames(page, paper_size.camera, frames)
    with plot_style.open_page(folder / "detail.png", _DETAIL_HEIGHT_PX) as page:
        (exact,) = paper_size.render_reference(FIGURE_SAMPLES)
        radius_px = paper_size.camera.horizon_radius_px
        _draw_polygon_detail(page, frames, exact, max_radius_px=radius_px)
