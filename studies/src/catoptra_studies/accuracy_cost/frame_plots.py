"""Plots of rendered frames: levels of the front, and the paper's Figures 8 and 9 with errors.

Figure 8 is the frame through four meshes, here above its displacement; Figure 9 a detail in which
facets show at 256 polygons and hardly at 1024, here above its difference in grey levels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel, signed_difference
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES
from catoptra_studies.camera_figures.polygon_figures import (
    DISPLACEMENT_RANGE_PX,
    colour_displacement,
    displacement_map,
    find_max_difference_window,
)
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX, POLYGON_COUNTS
from catoptra_studies.plot_style import (
    LIGHT_GREY,
    MUTED,
    Image,
    Page,
    add_text,
    draw_colour_bar,
    map_error_colours,
    open_page,
    outline_square,
    show_image,
)
from catoptra_studies.study_subject import StudySubject

MAX_COLUMNS = 6
# Crop in pixels of the frame, and the device pixels of each of them.
_LEVEL_CROP_PX, _LEVEL_ZOOM = 60, 4
_LEVELS_TOP_PX = 100
_DETAIL_CROP_PX, _DETAIL_ZOOM = 44, 8
_DETAIL_POLYGON_COUNTS = (256, 1024, 4096)
_TOP_PX = 56
# Below one grey level nothing is visible; half of full contrast is as bad as an error can look.
_GREY_LEVEL_RANGE = (1.0, 128.0)
_GREY_LEVEL_TICKS = (1, 4, 16, 64, 128)


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
    _write_level_details(folder / "levels.png", levels, reference, subject.camera.horizon_radius_px)
    # The paper's figures have the paper's size, of whatever size the study is.
    camera = subject.resize_camera(PAPER_SIZE_PX)
    # 4096 polygons are for detail.png alone; polygons.png ends with the paper's 1024.
    frames = {
        count: subject.render_frame(
            PAPER_SIZE_PX, FIGURE_SAMPLES, surface=tessellation_from_polygon_count(count)
        )
        for count in POLYGON_COUNTS
    }
    _write_polygon_frames(folder / "polygons.png", camera, frames)
    exact = subject.render_frame(PAPER_SIZE_PX, FIGURE_SAMPLES)
    _write_polygon_detail(
        folder / "detail.png", frames, exact, max_radius_px=camera.horizon_radius_px
    )


def select_front_levels(levels: Sequence[MeasuredLevel]) -> list[MeasuredLevel]:
    """Levels of the front from fast to exact, thinned evenly to MAX_COLUMNS with both ends."""
    front = sorted(
        (level for level in levels if level.cost.is_on_pareto_front),
        key=lambda level: level.cost.wall_ms,
    )
    # Rounded positions keep both ends and never repeat a level.
    chosen = np.linspace(0, len(front) - 1, min(len(front), MAX_COLUMNS)).round().astype(int)
    return [front[index] for index in chosen]


def _write_level_details(
    path: Path, levels: Sequence[MeasuredLevel], reference: Image, horizon_radius_px: float
) -> None:
    """Write a column for each level of the front, from fast to exact.

    Args:
        path: PNG file to write.
        levels: All measured levels.
        reference: Exact frame at the pose of the levels' frames.
        horizon_radius_px: Radius within which the detail is searched.
    """
    side = _LEVEL_CROP_PX * _LEVEL_ZOOM
    front = select_front_levels(levels)
    # Tests run at 64 px, where the whole detail would not fit within the horizon.
    size_px = min(_LEVEL_CROP_PX, reference.shape[0] // 3)
    # The detail where the fastest level is worst shows best how the others improve.
    row, column = find_max_difference_window(
        front[0].frame, reference, size_px, max_radius_px=horizon_radius_px
    )
    window = slice(row, row + size_px), slice(column, column + size_px)
    height_px = _LEVELS_TOP_PX + 2 * side + 120
    with open_page(path, height_px) as page:
        for index, level in enumerate(front):
            left = 15 + index * (side + 10)
            _draw_heading(page, level, left)
            detail = level.frame[window]
            show_image(page, detail, left, _LEVELS_TOP_PX, side)
            _show_difference(page, detail, reference[window], left, _LEVELS_TOP_PX + side + 8, side)
        draw_colour_bar(
            page, _GREY_LEVEL_RANGE, left=820, top=height_px - 84, width=480,
            ticks=_GREY_LEVEL_TICKS, title="below: difference from the reference, grey levels",
        )  # fmt: skip


def _draw_heading(page: Page, level: MeasuredLevel, left: int) -> None:
    surface, _, samples = level.cost.name.partition(", ")
    add_text(page, left, 12, surface, fontweight="bold", fontsize=7.5)
    add_text(page, left, 39, samples, fontsize=7.5)
    numbers = f"{level.cost.wall_ms:.1f} ms, RMSE {level.cost.rmse:.2g}"
    add_text(page, left, 66, numbers, fontsize=7.5, color=MUTED)


def _show_difference(
    page: Page, image: Image, reference: Image, left: int, top: int, width: int
) -> None:
    """Show the largest difference of each pixel's channels, with a border: no error is white."""
    error = np.abs(signed_difference(image, reference)).max(axis=-1)
    colours = map_error_colours(error, *_GREY_LEVEL_RANGE)
    axes = show_image(page, colours, left, top, width)
    axes.axis("on")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(visible=True, color=LIGHT_GREY)


def _write_polygon_detail(
    path: Path, frames: Mapping[int, Image], exact: Image, *, max_radius_px: float
) -> None:
    """Write the detail through three meshes and exactly, with the differences below.

    Args:
        path: PNG file to write.
        frames: Frames of the paper's size by number of polygons.
        exact: Frame of the exact mirror.
        max_radius_px: Radius of the horizon; the detail is searched within, where the floor's
            straight lines are.
    """
    side, step = _DETAIL_CROP_PX * _DETAIL_ZOOM, _DETAIL_CROP_PX * _DETAIL_ZOOM + 22
    coarsest = frames[_DETAIL_POLYGON_COUNTS[0]]
    row, column = find_max_difference_window(
        coarsest, exact, _DETAIL_CROP_PX, max_radius_px=max_radius_px
    )
    window = slice(row, row + _DETAIL_CROP_PX), slice(column, column + _DETAIL_CROP_PX)
    below, height_px = _TOP_PX + side + 14, _TOP_PX + 2 * side + 130
    details = [(f"{count} polygons", frames[count]) for count in _DETAIL_POLYGON_COUNTS]
    with open_page(path, height_px) as page:
        for index, (name, frame) in enumerate([*details, ("exact mirror", exact)]):
            left = 10 + index * step
            add_text(page, left, _TOP_PX - 10, name, va="bottom", fontweight="bold")
            show_image(page, frame[window], left, _TOP_PX, side)
            if frame is exact:
                # The whole frame in place of a difference, with the location of the detail.
                axes = show_image(page, exact, left, below, side)
                outline_square(axes, row, column, _DETAIL_CROP_PX)
            else:
                _show_difference(page, frame[window], exact[window], left, below, side)
        draw_colour_bar(
            page, _GREY_LEVEL_RANGE, left=820, top=height_px - 84, width=480,
            ticks=_GREY_LEVEL_TICKS, title="below: difference from the exact mirror, grey levels",
        )  # fmt: skip


def _write_polygon_frames(path: Path, camera: OmniCamera, frames: Mapping[int, Image]) -> None:
    """Write frames above displacement maps.

    Args:
        path: PNG file to write.
        camera: Camera of the paper's image size.
        frames: Frames of that size by number of polygons.
    """
    with open_page(path, 910) as page:
        for index, count in enumerate(PAPER_POLYGON_COUNTS):
            left = 10 + index * (PAPER_SIZE_PX + 20)
            error_px = displacement_map(camera, tessellation_from_polygon_count(count))
            rms_px = float(np.sqrt(np.nanmean(np.square(error_px))))
            add_text(page, left, _TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold")
            add_text(
                page, left + PAPER_SIZE_PX, _TOP_PX - 10, f"{rms_px:.3g} px rms", ha="right",
                va="bottom", fontsize=7, color=MUTED,
            )  # fmt: skip
            show_image(page, frames[count], left, _TOP_PX, PAPER_SIZE_PX)
            colours = colour_displacement(error_px)
            show_image(page, colours, left, _TOP_PX + PAPER_SIZE_PX + 14, PAPER_SIZE_PX)
        draw_colour_bar(
            page, DISPLACEMENT_RANGE_PX, left=820, top=910 - 84, width=480,
            ticks=(0.1, 1, 10, 100), title="below: displacement, px; grey: no polygon",
        )  # fmt: skip
