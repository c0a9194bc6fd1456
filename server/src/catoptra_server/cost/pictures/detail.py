"""The paper's Figure 9 with error maps: where 256 polygons still show, and 1024 hardly do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_server.cost.error_map import error_colours
from catoptra_server.cost.image_error import difference
from catoptra_server.cost.pictures.legend import draw_scale, framed
from catoptra_server.figures import style
from catoptra_server.figures.polygon_detail import worst_place
from catoptra_server.render.renderer import Image

COUNTS = (256, 1024, 4096)
DETAIL_PX, _ZOOM = 44, 8
_SIDE_PX, _TOP_PX = DETAIL_PX * _ZOOM, 56
WIDTH_PX, HEIGHT_PX = 1520, _TOP_PX + 2 * _SIDE_PX + 130
GREYS = (1.0, 128.0)


def draw(page: style.Page, frames: Mapping[int, Image], exact: Image, *, within_px: float) -> None:
    """Draw the detail through three meshes and exactly, all of the paper's size.

    within_px: the horizon's radius; below it is the ground with its lines.
    """
    row, column = worst_place(frames[COUNTS[0]], exact, DETAIL_PX, within_px=within_px)
    part = slice(row, row + DETAIL_PX), slice(column, column + DETAIL_PX)
    for index, count in enumerate(COUNTS):
        image = frames[count]
        left = 10 + index * (_SIDE_PX + 22)
        _column(page, f"{count} polygons", image[part], left)
        error = np.abs(difference(image[part], exact[part])).max(axis=-1)
        colours = error_colours(error, *GREYS)
        framed(style.picture(page, colours, left, _TOP_PX + _SIDE_PX + 14, _SIDE_PX))
    last = 10 + len(COUNTS) * (_SIDE_PX + 22)
    _column(page, "exact law", exact[part], last)
    _place(page, exact, (row, column), last)
    draw_scale(
        page, GREYS, left=820, top=HEIGHT_PX - 84, width=480, marks=(1, 4, 16, 64, 128),
        title="below: difference from the exact law, grey levels",
    )  # fmt: skip


def _column(page: style.Page, name: str, detail: Image, left: int) -> None:
    style.words(page, left, _TOP_PX - 10, name, va="bottom", fontweight="bold")
    style.picture(page, detail, left, _TOP_PX, _SIDE_PX)


def _place(page: style.Page, exact: Image, corner: tuple[int, int], left: int) -> None:
    """Show the whole frame and where the detail is."""
    over = style.picture(page, exact, left, _TOP_PX + _SIDE_PX + 14, _SIDE_PX)
    v, u = corner
    over.plot(
        [u, u + DETAIL_PX, u + DETAIL_PX, u, u], [v, v, v + DETAIL_PX, v + DETAIL_PX, v],
        color=style.RED,
    )  # fmt: skip
