"""The paper's Figure 9 with error maps: facets that show at 256 polygons and hardly at 1024."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.image_error import signed_difference
from catoptra_studies.camera_figures.polygon_figures import find_max_difference_window
from catoptra_studies.plot_style import Image, draw_colour_bar, map_error_colours

_POLYGON_COUNTS = (256, 1024, 4096)
_CROP_PX, _ZOOM = 44, 8
_SIDE_PX, _TOP_PX = _CROP_PX * _ZOOM, 56
DETAIL_HEIGHT_PX = _TOP_PX + 2 * _SIDE_PX + 130
# Below one grey level nothing is visible; half of full contrast is as bad as an error can look.
GREY_LEVEL_RANGE = (1.0, 128.0)


def draw_polygon_detail(
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
        left = 10 + index * (_SIDE_PX + 22)
        _draw_column(page, f"{count} polygons", detail, left)
        error = np.abs(signed_difference(detail, exact[window])).max(axis=-1)
        colours = map_error_colours(error, *GREY_LEVEL_RANGE)
        plot_style.draw_border(
            plot_style.show_image(page, colours, left, _TOP_PX + _SIDE_PX + 14, _SIDE_PX)
        )
    last = 10 + len(_POLYGON_COUNTS) * (_SIDE_PX + 22)
    _draw_column(page, "exact mirror", exact[window], last)
    _draw_location(page, exact, (row, column), last)
    draw_colour_bar(
        page, GREY_LEVEL_RANGE, left=820, top=DETAIL_HEIGHT_PX - 84, width=480,
        ticks=(1, 4, 16, 64, 128), title="below: difference from the exact mirror, grey levels",
    )  # fmt: skip


def _draw_column(page: plot_style.Page, name: str, detail: Image, left: int) -> None:
    plot_style.add_text(page, left, _TOP_PX - 10, name, va="bottom", fontweight="bold")
    plot_style.show_image(page, detail, left, _TOP_PX, _SIDE_PX)


def _draw_location(page: plot_style.Page, exact: Image, corner: tuple[int, int], left: int) -> None:
    """Show the whole frame with a square around the detail."""
    axes = plot_style.show_image(page, exact, left, _TOP_PX + _SIDE_PX + 14, _SIDE_PX)
    v, u = corner
    axes.plot(
        [u, u + _CROP_PX, u + _CROP_PX, u, u], [v, v, v + _CROP_PX, v + _CROP_PX, v],
        color=plot_style.RED,
    )  # fmt: skip
