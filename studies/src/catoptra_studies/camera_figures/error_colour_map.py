"""Colours of errors on a logarithmic scale: white for none, through yellow and red to black.

The errors of a sweep span decades, so a linear scale would show the coarsest level alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_studies import plot_style
from catoptra_studies.plot_style import Image

# Brightness falls from stop to stop, so that the order survives printing in grey.
_COLOUR_STOPS = np.array(
    [(255, 255, 255), (255, 236, 160), (250, 160, 60), (209, 41, 61), (110, 10, 70), (20, 8, 30)],
    dtype=np.float64,
)


def map_error_colours(errors: Floats, min_error: float, max_error: float) -> Image:
    """Colour of each error.

    Args:
        errors: (...) errors >= 0.
        min_error: Error at and below which all is white, > 0.
        max_error: Error at and above which all is black.

    Returns:
        (..., 3) uint8 RGB.
    """
    decades = math.log(max_error / min_error)
    # 0 at min_error, 1 at max_error. Zero has no logarithm, so small errors are raised first.
    fraction = np.log(np.maximum(errors, min_error) / min_error) / decades
    stops = np.linspace(0.0, 1.0, len(_COLOUR_STOPS))
    channels = [np.interp(fraction, stops, channel) for channel in _COLOUR_STOPS.T]
    colours: Image = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return colours


def colour_bar(width_px: int, height_px: int, min_error: float, max_error: float) -> Image:
    """Image of the scale itself, from left to right."""
    errors = np.geomspace(min_error, max_error, width_px)
    return np.repeat(map_error_colours(errors, min_error, max_error)[None], height_px, axis=0)


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


def _bar_position(error: float, limits: tuple[float, float], width: int) -> float:
    min_error, max_error = limits
    return width * math.log(error / min_error) / math.log(max_error / min_error)
