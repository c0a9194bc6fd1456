"""Palette, pages and charts of every figure; the only module that imports Matplotlib.

A page is laid out in device pixels from the top left corner, so that a rendered image can be shown
pixel by pixel. A chart is laid out by Matplotlib and has any size in inches. Both set Matplotlib's
settings for their own block only, and are written when the block ends.

Errors have one colour scale, logarithmic, white for none, through yellow and red to black. The
errors of a sweep span decades, so a linear scale would show the coarsest level alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats

# (h, w, 3) RGB image.
Image = npt.NDArray[np.uint8]

# Matplotlib publishes no types.
Page = Any
Axes = Any

FOREGROUND, MUTED, LIGHT_GREY, BACKGROUND = "#1c2833", "#66727d", "#d7dce1", "#ffffff"
RED, BLUE, ORANGE, TEAL = "#d1293d", "#1f5fa8", "#d97706", "#138a74"

# One colour for one quantity in every chart of a drive.
TRUTH = "#222222"
ODOMETRY = "#d1495b"
ESTIMATE = "#2e6fbb"
ACCEPTED = "#2a9d5c"
REJECTED = "#d98c21"
LANDMARK_COLOURS = {"cyan": "#00aadc", "magenta": "#e1238c", "yellow": "#e8c400"}

# 200 device pixels an inch. A report shows figures at five eighths of their pixels, which
# stay crisp on a dense display, with text as large as the report's.
_DPI = 200
PAGE_WIDTH_PX = 1520
# Width in inches of a chart that is as wide as a page.
PAGE_WIDTH_IN = PAGE_WIDTH_PX / _DPI
# A report embeds all its figures. Pages above this size have many thin lines, which look
# the same in 256 colours; rendered frames stay below.
_MAX_FULL_COLOUR_BYTES = 280_000

_SETTINGS = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": FOREGROUND,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LIGHT_GREY,
    "grid.linewidth": 0.5,
    "text.color": FOREGROUND,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": FOREGROUND,
    "ytick.labelcolor": FOREGROUND,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
}


@contextmanager
def open_page(path: Path, height_px: int, width_px: int = PAGE_WIDTH_PX) -> Iterator[Page]:
    """Yield an empty page of exact size, written to a file when the block ends."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(_SETTINGS):
        size = (width_px / _DPI, height_px / _DPI)
        # pyplot would keep the figure alive and choose a window system.
        page = Figure(figsize=size, dpi=_DPI, facecolor=BACKGROUND)
        FigureCanvasAgg(page)
        yield page
        _save_page(page, path)


def _save_page(page: Page, path: Path) -> None:
    """Write a page as PNG, with 256 colours where the file would be too large otherwise."""
    from PIL import Image as PillowImage

    page.canvas.draw()
    pixels = PillowImage.fromarray(np.asarray(page.canvas.buffer_rgba())[..., :3].copy())
    # Pillow's `optimize` makes a page up to 5 % smaller and takes five times as long.
    pixels.save(path)
    if path.stat().st_size > _MAX_FULL_COLOUR_BYTES:
        # Dithering would add noise to flat colours and make the file larger again.
        pixels.quantize(256, dither=PillowImage.Dither.NONE).save(path)


@contextmanager
def open_chart(path: Path, **arguments: Any) -> Iterator[Any]:
    """Yield a Matplotlib figure with automatic layout, written to a file when the block ends.

    Args:
        path: PNG file to write.
        **arguments: Arguments of matplotlib.figure.Figure, such as figsize in inches.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_SETTINGS):
        figure = Figure(layout="constrained", **arguments)
        yield figure
        figure.savefig(path, dpi=_DPI)


def add_axes(page: Page, left: float, top: float, width: float, height: float) -> Axes:
    """Add axes on a rectangle of the page, all in device pixels."""
    page_width, page_height = page.get_size_inches() * _DPI
    # Matplotlib counts fractions from the lower left corner.
    return page.add_axes(
        (
            left / page_width,
            1.0 - (top + height) / page_height,
            width / page_width,
            height / page_height,
        )
    )


def add_pixel_axes(page: Page, left: float, top: float, width: float, height: float) -> Axes:
    """Add axes without lines, in device pixels, v down."""
    axes = add_axes(page, left, top, width, height)
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.axis("off")
    return axes


def show_image(page: Page, image: Image, left: int, top: int, width: int) -> Axes:
    """Show an image pixel by pixel.

    Args:
        page: Page to draw on.
        image: Image to show.
        left: Device pixels from the page's left edge.
        top: Device pixels from the page's upper edge.
        width: Device pixels of the image's row; a multiple of the columns makes all blocks equal.

    Returns:
        Axes over the image, in the image's own pixel coordinates.
    """
    rows, columns = image.shape[:2]
    height = round(width * rows / columns)
    axes = add_axes(page, left, top, width, height)
    axes.axis("off")
    # Repeated here: Matplotlib's resampling moves edges by a pixel.
    row = np.arange(height) * rows // height
    column = np.arange(width) * columns // width
    axes.imshow(image[row][:, column], extent=(0, columns, rows, 0), interpolation="none")
    axes.set(xlim=(0, columns), ylim=(rows, 0), aspect="auto")
    return axes


def outline_square(axes: Axes, row: int, column: int, size_px: int) -> None:
    """Outline a square of an image, given the upper left corner."""
    u, v = (column, column + size_px), (row, row + size_px)
    axes.plot([u[0], u[1], u[1], u[0], u[0]], [v[0], v[0], v[1], v[1], v[0]], color=RED)


def label_box(pad: float, **options: Any) -> dict[str, Any]:
    """Background of a label that stands on lines or an image."""
    return {"facecolor": BACKGROUND, "edgecolor": "none", "pad": pad, **options}


def add_legend(figure: Page, *axes: Axes, **options: Any) -> None:
    """Draw one legend of a figure for the series of several axes."""
    pairs = [one.get_legend_handles_labels() for one in axes]
    handles = [handle for pair in pairs for handle in pair[0]]
    labels = [label for pair in pairs for label in pair[1]]
    figure.legend(handles, labels, **options)


def add_text(page: Page, left: float, top: float, text: str, **options: Any) -> None:
    """Write text with the upper left corner at (left, top), unless `options` aligns otherwise."""
    page_width, page_height = page.get_size_inches() * _DPI
    alignment = {"ha": "left", "va": "top"} | options
    page.text(left / page_width, 1.0 - top / page_height, text, **alignment)


def fill_polygons(
    axes: Axes, corners: Floats, colours: Floats, *, edge: str = "face", line: float = 0.25
) -> None:
    """Fill polygons in the order given.

    Args:
        axes: Axes to draw on.
        corners: (n, k, 2) corners in data coordinates.
        colours: (n, 3) or (n, 4) colours in [0, 1].
        edge: Colour of the edges; "face" hides the seams between neighbours.
        line: Width of the edges in points.
    """
    from matplotlib.collections import PolyCollection

    axes.add_collection(
        PolyCollection(list(corners), facecolors=colours, edgecolors=edge, linewidths=line),
        autolim=False,
    )


def show_skewed_image(axes: Axes, image: Image, data_from_unit: Floats) -> None:
    """Show an image on a parallelogram.

    Args:
        axes: Axes to draw on.
        image: Image to show.
        data_from_unit: (2, 3) affine map from the image's plane, [-1, 1] right and down, to data
            coordinates.
    """
    from matplotlib.patches import Polygon
    from matplotlib.transforms import Affine2D

    matrix = np.vstack((data_from_unit, (0.0, 0.0, 1.0)))
    artist = axes.imshow(
        image,
        extent=(-1.0, 1.0, 1.0, -1.0),
        transform=Affine2D(matrix) + axes.transData,
        interpolation="bilinear",
        interpolation_stage="rgba",
    )
    # Resampling leaves a ragged edge, which the clip path cuts along the parallelogram.
    corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) @ data_from_unit.T
    artist.set_clip_path(Polygon(corners, transform=axes.transData))


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


def _colour_bar(width_px: int, height_px: int, min_error: float, max_error: float) -> Image:
    """Image of the scale itself, from left to right."""
    errors = np.geomspace(min_error, max_error, width_px)
    return np.repeat(map_error_colours(errors, min_error, max_error)[None], height_px, axis=0)


def draw_colour_bar(
    page: Page,
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
    bar = show_image(page, _colour_bar(width, 22, *limits), left, top, width)
    # show_image hides the axes, but here the axes are the scale.
    bar.axis("on")
    bar.set_yticks([])
    bar.grid(visible=False)
    min_error, max_error = limits
    decades = math.log(max_error / min_error)
    positions = [width * math.log(tick / min_error) / decades for tick in ticks]
    bar.set_xticks(positions, [f"{tick:g}" for tick in ticks])
    add_text(page, left - 14, top + 11, title, ha="right", va="center")
