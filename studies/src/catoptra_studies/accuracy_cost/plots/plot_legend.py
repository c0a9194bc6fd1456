"""Parts that several plots share: the style of each series, and borders."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LevelCost


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
