"""Levels of the Pareto front: the same detail of the frame, and the error of its greys."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.image_error import signed_difference
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel
from catoptra_studies.camera_figures.polygon_figures import find_max_difference_window
from catoptra_studies.plot_style import Image, draw_colour_bar, map_error_colours

MAX_COLUMNS = 6
_LEVEL_CROP_PX, _ZOOM = 60, 4
_SIDE_PX, _GAP_PX, _TOP_PX = _LEVEL_CROP_PX * _ZOOM, 10, 100
LEVELS_HEIGHT_PX = _TOP_PX + 2 * _SIDE_PX + 120
GREY_LEVEL_RANGE = (1.0, 128.0)


def draw_level_details(
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
        colours = map_error_colours(error, *GREY_LEVEL_RANGE)
        plot_style.draw_border(
            plot_style.show_image(page, colours, left, _TOP_PX + _SIDE_PX + 8, _SIDE_PX)
        )
    draw_colour_bar(
        page, GREY_LEVEL_RANGE, left=820, top=LEVELS_HEIGHT_PX - 84, width=480,
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
