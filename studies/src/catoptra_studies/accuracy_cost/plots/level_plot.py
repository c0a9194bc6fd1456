"""What each step of the front buys: the same detail of the frame, and how far its greys are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_server.render.renderer import Image
from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.error_colour_map import map_error_colours
from catoptra_studies.accuracy_cost.image_error import signed_difference
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel
from catoptra_studies.accuracy_cost.plots.plot_legend import draw_border, draw_colour_bar
from catoptra_studies.camera_figures.polygon_detail_figure import find_max_difference_window

MAX_COLUMNS = 6
DETAIL_PX, _ZOOM = 60, 4
_SIDE_PX, _GAP_PX, _TOP_PX = DETAIL_PX * _ZOOM, 10, 100
WIDTH_PX, HEIGHT_PX = 1520, _TOP_PX + 2 * _SIDE_PX + 120
GREY_LEVEL_RANGE = (1.0, 128.0)


def draw(
    page: plot_style.Page,
    levels: Sequence[MeasuredLevel],
    reference: Image,
    horizon_radius_px: float,
) -> None:
    """Draw a column for each step of the front, from fast to exact."""
    front = select_front_levels(levels)
    side = min(DETAIL_PX, reference.shape[0] // 3)
    row, column = find_max_difference_window(
        front[0].frame, reference, side, max_radius_px=horizon_radius_px
    )
    part = slice(row, row + side), slice(column, column + side)
    for index, one in enumerate(front):
        left = 15 + index * (_SIDE_PX + _GAP_PX)
        _draw_heading(page, one, left)
        plot_style.show_image(page, one.frame[part], left, _TOP_PX, _SIDE_PX)
        error = np.abs(signed_difference(one.frame[part], reference[part])).max(axis=-1)
        colours = map_error_colours(error, *GREY_LEVEL_RANGE)
        draw_border(plot_style.show_image(page, colours, left, _TOP_PX + _SIDE_PX + 8, _SIDE_PX))
    draw_colour_bar(
        page, GREY_LEVEL_RANGE, left=820, top=HEIGHT_PX - 84, width=480, ticks=(1, 4, 16, 64, 128),
        title="below: difference from the reference, grey levels",
    )  # fmt: skip


def select_front_levels(levels: Sequence[MeasuredLevel]) -> list[MeasuredLevel]:
    """Return the steps of the front from fast to exact, evenly thinned to the most that fit."""
    front = sorted(
        (one for one in levels if one.cost.is_on_pareto_front), key=lambda one: one.cost.wall_ms
    )
    chosen = np.linspace(0, len(front) - 1, min(len(front), MAX_COLUMNS)).round().astype(int)
    return [front[index] for index in chosen]


def _draw_heading(page: plot_style.Page, level: MeasuredLevel, left: int) -> None:
    what, _, how = level.cost.name.partition(", ")
    plot_style.add_text(page, left, 12, what, fontweight="bold", fontsize=7.5)
    plot_style.add_text(page, left, 39, how, fontsize=7.5)
    numbers = f"{level.cost.wall_ms:.1f} ms, RMSE {level.cost.rmse:.2g}"
    plot_style.add_text(page, left, 66, numbers, fontsize=7.5, color=plot_style.MUTED)
