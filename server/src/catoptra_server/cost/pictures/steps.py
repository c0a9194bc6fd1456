"""What each step of the front buys: the same detail of the frame, and how far its greys are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_server.cost.error_map import error_colours
from catoptra_server.cost.image_error import difference
from catoptra_server.cost.pictures.legend import draw_scale, framed
from catoptra_server.cost.step_costs import Drawn
from catoptra_server.figures import style
from catoptra_server.figures.polygon_detail import worst_place
from catoptra_server.render.renderer import Image

MOST = 6
DETAIL_PX, _ZOOM = 60, 4
_SIDE_PX, _GAP_PX, _TOP_PX = DETAIL_PX * _ZOOM, 10, 100
WIDTH_PX, HEIGHT_PX = 1520, _TOP_PX + 2 * _SIDE_PX + 120
GREYS = (1.0, 128.0)


def draw(page: style.Page, drawn: Sequence[Drawn], reference: Image, horizon_px: float) -> None:
    """Draw a column for each step of the front, from fast to exact."""
    front = shown(drawn)
    side = min(DETAIL_PX, reference.shape[0] // 3)
    row, column = worst_place(front[0].frame, reference, side, within_px=horizon_px)
    part = slice(row, row + side), slice(column, column + side)
    for index, one in enumerate(front):
        left = 15 + index * (_SIDE_PX + _GAP_PX)
        _head(page, one, left)
        style.picture(page, one.frame[part], left, _TOP_PX, _SIDE_PX)
        error = np.abs(difference(one.frame[part], reference[part])).max(axis=-1)
        colours = error_colours(error, *GREYS)
        framed(style.picture(page, colours, left, _TOP_PX + _SIDE_PX + 8, _SIDE_PX))
    draw_scale(
        page, GREYS, left=820, top=HEIGHT_PX - 84, width=480, marks=(1, 4, 16, 64, 128),
        title="below: difference from the reference, grey levels",
    )  # fmt: skip


def shown(drawn: Sequence[Drawn]) -> list[Drawn]:
    """Return the steps of the front from fast to exact, evenly thinned to the most that fit."""
    front = sorted((one for one in drawn if one.cost.is_on_front), key=lambda one: one.cost.ms)
    chosen = np.linspace(0, len(front) - 1, min(len(front), MOST)).round().astype(int)
    return [front[index] for index in chosen]


def _head(page: style.Page, one: Drawn, left: int) -> None:
    what, _, how = one.cost.name.partition(", ")
    style.words(page, left, 12, what, fontweight="bold", fontsize=7.5)
    style.words(page, left, 39, how, fontsize=7.5)
    numbers = f"{one.cost.ms:.1f} ms, RMSE {one.cost.rmse:.2g}"
    style.words(page, left, 66, numbers, fontsize=7.5, color=style.QUIET)
