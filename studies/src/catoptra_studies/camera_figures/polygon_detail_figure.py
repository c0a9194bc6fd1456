"""A straight line through 256 polygons in magnified detail: the paper's Figure 9.

The detail is found, not chosen: the window below the horizon, on the floor with its lines, in which
the coarser mesh differs most from the exact mirror.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES, FigureCaption, FigureInputs
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.plot_style import Image

_DETAIL_PX = 44
_ZOOM = 8
_COARSE, _FINE = 256, 1024


def draw_polygon_detail(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the location in the frame, and the detail through two meshes and the exact mirror."""
    subject = inputs.subject
    exact = subject.render_frame(PAPER_SIZE_PX, FIGURE_SAMPLES)
    meshes = [
        subject.render_frame(
            PAPER_SIZE_PX, FIGURE_SAMPLES, surface=tessellation_from_polygon_count(count)
        )
        for count in (_COARSE, _FINE)
    ]
    # Tests render smaller frames; the detail shrinks with them.
    size_px = round(_DETAIL_PX * exact.shape[0] / PAPER_SIZE_PX)
    radius_px = subject.resize_camera(exact.shape[0]).horizon_radius_px
    row, column = find_max_difference_window(meshes[0], exact, size_px, max_radius_px=radius_px)
    _draw_location(page, exact, row, column, size_px)
    names = (f"{_COARSE} polygons", f"{_FINE} polygons", "exact surface")
    for index, (name, image) in enumerate(zip(names, (*meshes, exact), strict=True)):
        left = 400 + index * (_ZOOM * _DETAIL_PX + 20)
        plot_style.add_text(page, left, 56, name, va="bottom", fontweight="bold")
        detail = image[row : row + size_px, column : column + size_px]
        plot_style.show_image(page, detail, left, 66, _ZOOM * _DETAIL_PX)
    return _caption()


def find_max_difference_window(
    image: Image, reference: Image, size_px: int, *, max_radius_px: float
) -> tuple[int, int]:
    """Upper left corner of the square window in which two images differ most.

    Args:
        image: Image of equal width and height.
        reference: Image to compare with, of the same shape.
        size_px: Side of the window.
        max_radius_px: Radius around the image's centre that the whole window must not exceed.

    Returns:
        (row, column) of the corner.
    """
    difference = np.square(image.astype(np.float64) - reference).sum(axis=-1)
    # Only the central half of a window counts, so that the difference lies well within it.
    quarter = size_px // 4
    sums = _window_sums(difference[quarter:-quarter, quarter:-quarter], size_px - 2 * quarter)
    corner = np.arange(sums.shape[0])[:, None], np.arange(sums.shape[1])[None, :]
    centre = 0.5 * image.shape[0]
    # Of the four corners of a window the one farthest from the centre decides.
    reach = [np.maximum(np.abs(c - centre), np.abs(c + size_px - centre)) for c in corner]
    sums[np.hypot(*reach) > max_radius_px] = -1.0
    row, column = np.unravel_index(np.argmax(sums), sums.shape)
    return int(row), int(column)


def _window_sums(values: Floats, size_px: int) -> Floats:
    """Sum over each (size_px, size_px) window, by four lookups in the integral image."""
    integral = np.pad(values, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    sums: Floats = (
        integral[size_px:, size_px:] - integral[:-size_px, size_px:] - integral[size_px:, :-size_px]
    ) + integral[:-size_px, :-size_px]
    return sums


def _draw_location(
    page: plot_style.Page, exact: Image, row: int, column: int, size_px: int
) -> None:
    axes = plot_style.show_image(page, exact, 20, 66, _ZOOM * _DETAIL_PX)
    u, v = (column, column + size_px), (row, row + size_px)
    axes.plot([u[0], u[1], u[1], u[0], u[0]], [v[0], v[0], v[1], v[1], v[0]], color=plot_style.RED)
    plot_style.add_text(page, 20, 56, "location", va="bottom", fontweight="bold")


def _caption() -> FigureCaption:
    return FigureCaption(
        title="Jaggings of a straight line",
        caption=(
            f"The window below the horizon in which {_COARSE} polygons differ most from the exact "
            f"surface: {_DETAIL_PX} × {_DETAIL_PX} pixels, magnified. A straight edge of the world "
            f"should be one smooth curve; facets break it into pieces. With {_FINE} polygons the "
            "kinks hardly show."
        ),
        alt=(
            "The frame with a red square, and the square's content three times enlarged: with a "
            "jagged line, with a slightly uneven one, and with a smooth one."
        ),
        metrics={"detail_px": _DETAIL_PX, "polygons": _COARSE, "polygons_finer": _FINE},
    )
