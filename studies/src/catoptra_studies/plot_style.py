"""How every figure looks, and the only door to Matplotlib: palette, page, pixel-exact pictures.

Places and sizes on a page are device pixels from its top left corner, so that a rendered picture
can be shown pixel by pixel. Nothing is changed at import; a page's settings end with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image

FOREGROUND, MUTED, LIGHT_GREY, BACKGROUND = "#1c2833", "#66727d", "#d7dce1", "#ffffff"
RED, BLUE, ORANGE, TEAL = "#d1293d", "#1f5fa8", "#d97706", "#138a74"

# 200 device pixels an inch: a page of PAGE_WIDTH_PX is shown at half its pixels on a report's 760 px
# column and stays crisp on a dense display.
_DPI = 200
PAGE_WIDTH_PX = 1520
# A report holds all figures in one file; a page above this is one of many drawn lines, and loses
# nothing that an eye can see.
_MAX_FULL_COLOUR_BYTES = 280_000
# Matplotlib's objects come without types.
Page = Any
Axes = Any

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
}


@contextmanager
def open_page(width_px: int, height_px: int) -> Iterator[Page]:
    """Yield an empty page; draw and save it inside. Raises CatoptraError without Matplotlib."""
    try:
        from matplotlib import rc_context
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise CatoptraError(
            "the figures need Matplotlib: pip install 'catoptra-server[figures]'"
        ) from error
    with rc_context(_SETTINGS):
        drawn = Figure(figsize=(width_px / _DPI, height_px / _DPI), dpi=_DPI, facecolor=BACKGROUND)
        FigureCanvasAgg(drawn)
        yield drawn


def save_page(page: Page, path: Path) -> None:
    """Write a page as PNG; only a page that would be too large is reduced to 256 colours."""
    from PIL import Image as PillowImage

    page.canvas.draw()
    pixels = PillowImage.fromarray(np.asarray(page.canvas.buffer_rgba())[..., :3].copy())
    pixels.save(path, optimize=True)
    if path.stat().st_size > _MAX_FULL_COLOUR_BYTES:
        pixels.quantize(256, dither=PillowImage.Dither.NONE).save(path, optimize=True)


def add_axes(page: Page, left: float, top: float, width: float, height: float) -> Axes:
    """Return axes on a rectangle of the page."""
    page_width, page_height = page.get_size_inches() * _DPI
    return page.add_axes(
        (
            left / page_width,
            1.0 - (top + height) / page_height,
            width / page_width,
            height / page_height,
        )
    )


def add_pixel_axes(page: Page, left: float, top: float, width: float, height: float) -> Axes:
    """Return bare axes whose data coordinates are their own pixels, v down."""
    bare = add_axes(page, left, top, width, height)
    bare.set(xlim=(0.0, width), ylim=(height, 0.0))
    bare.axis("off")
    return bare


def show_image(page: Page, image: Image, left: int, top: int, width: int) -> Axes:
    """Show an image pixel by pixel, each as a block of equal size where `width` is a multiple.

    Returns axes over it, in the image's own pixel coordinates.
    """
    rows, columns = image.shape[:2]
    height = round(width * rows / columns)
    shown = add_axes(page, left, top, width, height)
    shown.axis("off")
    row = np.arange(height) * rows // height
    column = np.arange(width) * columns // width
    shown.imshow(image[row][:, column], extent=(0, columns, rows, 0), interpolation="none")
    shown.set(xlim=(0, columns), ylim=(rows, 0), aspect="auto")
    return shown


def add_text(page: Page, left: float, top: float, text: str, **options: Any) -> None:
    """Write on the page; (left, top) is where the text begins, unless options align it."""
    page_width, page_height = page.get_size_inches() * _DPI
    aligned = {"ha": "left", "va": "top"} | options
    page.text(left / page_width, 1.0 - top / page_height, text, **aligned)


def fill_polygons(
    axes: Axes, corners: Floats, colours: Floats, *, edge: str = "face", line: float = 0.25
) -> None:
    """Fill (n, k, 2) polygons with (n, 3) or (n, 4) colours, in order; edges hide the seams."""
    from matplotlib.collections import PolyCollection

    axes.add_collection(
        PolyCollection(list(corners), facecolors=colours, edgecolors=edge, linewidths=line),
        autolim=False,
    )


def show_skewed_image(axes: Axes, image: Image, data_from_unit: npt.NDArray[np.float64]) -> None:
    """Show an image on a parallelogram; (2, 3) maps its plane, [-1, 1] right and down, to data."""
    from matplotlib.patches import Polygon
    from matplotlib.transforms import Affine2D

    matrix = np.vstack((data_from_unit, (0.0, 0.0, 1.0)))
    shown = axes.imshow(
        image,
        extent=(-1.0, 1.0, 1.0, -1.0),
        transform=Affine2D(matrix) + axes.transData,
        interpolation="bilinear",
        interpolation_stage="rgba",
    )
    outline = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) @ data_from_unit.T
    shown.set_clip_path(Polygon(outline, transform=axes.transData))
