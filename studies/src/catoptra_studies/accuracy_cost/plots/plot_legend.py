"""Parts that several plots share: the style of each series, a colour bar of errors, borders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.accuracy_cost.error_colour_map import colour_bar


@dataclass(frozen=True, slots=True)
class SeriesStyle:
    """Style of the points of one kind of level."""

    name: str
    colour: str

    marker: str
    """Matplotlib's letter of a marker."""


# Markers differ as well as colours, for readers who confuse two of these.
TRACE_STYLE = SeriesStyle("trace, camera model in every ray", plot_style.BLUE, "D")
PER_PIXEL_STYLE = SeriesStyle("raster, camera model in every pixel", plot_style.TEAL, "o")
UV_STYLE = SeriesStyle("raster, polygons, UV as in the paper", plot_style.ORANGE, "s")
POSITION_STYLE = SeriesStyle("raster, polygons, position", plot_style.RED, "^")
SERIES_STYLES = (TRACE_STYLE, PER_PIXEL_STYLE, UV_STYLE, POSITION_STYLE)


def series_style(level: LevelCost) -> SeriesStyle:
    """Style of a level's point."""
    if level.renderer == "trace":
        return TRACE_STYLE
    if not level.num_polygons:
        return PER_PIXEL_STYLE
    # By the name: cost.json can be plotted without the server's types.
    return UV_STYLE if "(uv)" in level.name else POSITION_STYLE


def draw_colour_bar(
    page: plot_style.Page,
    limits: tuple[float, float],
    *,
    left: int,
    top: int,
    width: int,
    ticks: Sequence[float],
    title: str,
) -> None:
    """Draw the scale of `map_error_colours`.

    Args:
        page: Page to draw on.
        limits: Errors at the left and the right end.
        left: Device pixels from the page's left edge to the bar.
        top: Device pixels from the page's upper edge to the bar.
        width: Device pixels of the bar.
        ticks: Errors with a number below the bar.
        title: Text to the left of the bar.
    """
    bar = plot_style.show_image(page, colour_bar(width, 22, *limits), left, top, width)
    # show_image hides the axes, but here they are the scale.
    bar.axis("on")
    bar.set_yticks([])
    bar.grid(visible=False)
    bar.set_xticks(
        [_bar_position(tick, limits, width) for tick in ticks], [f"{tick:g}" for tick in ticks]
    )
    plot_style.add_text(page, left - 14, top + 11, title, ha="right", va="center")


def draw_border(axes: plot_style.Axes) -> None:
    """Draw a thin border around an image that is white where no error is."""
    axes.axis("on")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(visible=True, color=plot_style.LIGHT_GREY)


def _bar_position(error: float, limits: tuple[float, float], width: int) -> float:
    min_error, max_error = limits
    return width * math.log(error / min_error) / math.log(max_error / min_error)
