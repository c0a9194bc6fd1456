"""What the pictures have in common: how families of steps look, and a scale of errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.accuracy_cost.error_colour_map import colour_bar


@dataclass(frozen=True, slots=True)
class SeriesStyle:
    """How the points of a family are drawn."""

    name: str
    colour: str
    marker: str


TRACE_STYLE = SeriesStyle("trace, exact law in every ray", plot_style.BLUE, "D")
PER_PIXEL_STYLE = SeriesStyle("raster, exact law in every pixel", plot_style.TEAL, "o")
UV_STYLE = SeriesStyle("raster, polygons, UV as in the paper", plot_style.ORANGE, "s")
POSITION_STYLE = SeriesStyle("raster, polygons, position", plot_style.RED, "^")
SERIES_STYLES = (TRACE_STYLE, PER_PIXEL_STYLE, UV_STYLE, POSITION_STYLE)


def series_style(level: LevelCost) -> SeriesStyle:
    """Return how a step is drawn."""
    if level.renderer == "trace":
        return TRACE_STYLE
    if not level.num_polygons:
        return PER_PIXEL_STYLE
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
    """Draw the scale of `map_error_colours` between two ends, with marks below and its title beside."""
    least, largest = limits
    bar = plot_style.show_image(page, colour_bar(width, 22, least, largest), left, top, width)
    bar.axis("on")
    bar.set_yticks([])
    bar.grid(visible=False)
    bar.set_xticks(
        [_bar_position(mark, limits, width) for mark in ticks], [f"{mark:g}" for mark in ticks]
    )
    plot_style.add_text(page, left - 14, top + 11, title, ha="right", va="center")


def draw_border(axes: plot_style.Axes) -> None:
    """Draw a thin frame round a picture whose own ground is white."""
    axes.axis("on")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(visible=True, color=plot_style.LIGHT_GREY)


def _bar_position(value: float, limits: tuple[float, float], width: int) -> float:
    least, largest = limits
    return width * math.log(value / least) / math.log(largest / least)
