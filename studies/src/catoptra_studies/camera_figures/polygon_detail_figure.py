"""Where 256 polygons still show: a straight line in magnified detail, the paper's Figure 9.

The detail is not chosen by hand: it is the place below the horizon, on the ground with its lines,
where the coarser mirror's picture differs most from the exact one.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX, FigureSubject

_DETAIL_PX = 44
_ZOOM = 8
_POLYGON_COUNTS = (256, 1024)


def draw(page: plot_style.Page, subject: FigureSubject) -> FigureCaption:
    """Draw the place in the frame, and the detail through two meshes and the exact surface."""
    exact = subject.render_frame(PAPER_SIZE_PX, samples=3)
    meshes = [
        subject.render_frame(PAPER_SIZE_PX, samples=3, surface=tessellation_from_polygon_count(n))
        for n in _POLYGON_COUNTS
    ]
    side = round(_DETAIL_PX * exact.shape[0] / PAPER_SIZE_PX)
    within_px = subject.resize_camera(exact.shape[0]).horizon_radius_px
    row, column = find_max_difference_window(meshes[0], exact, side, max_radius_px=within_px)
    _draw_location(page, exact, row, column, side)
    names = (*(f"{count} polygons" for count in _POLYGON_COUNTS), "exact surface")
    for index, (name, image) in enumerate(zip(names, (*meshes, exact), strict=True)):
        left = 400 + index * (_ZOOM * _DETAIL_PX + 20)
        plot_style.add_text(page, left, 56, name, va="bottom", fontweight="bold")
        detail = image[row : row + side, column : column + side]
        plot_style.show_image(page, detail, left, 66, _ZOOM * _DETAIL_PX)
    return _caption()


def find_max_difference_window(
    image: Image, reference: Image, size_px: int, *, max_radius_px: float
) -> tuple[int, int]:
    """Return (row, column) of the square window in which two pictures differ most.

    Only windows wholly within a radius of the picture's middle.
    """
    difference = np.square(image.astype(np.float64) - reference).sum(axis=-1)
    # The middle half of a window counts, so that what differs lies well within it.
    quarter = size_px // 4
    sums = _window_sums(difference[quarter:-quarter, quarter:-quarter], size_px - 2 * quarter)
    corner = np.arange(sums.shape[0])[:, None], np.arange(sums.shape[1])[None, :]
    centre = 0.5 * image.shape[0]
    reach = [np.maximum(np.abs(c - centre), np.abs(c + size_px - centre)) for c in corner]
    sums[np.hypot(*reach) > max_radius_px] = -1.0
    row, column = np.unravel_index(np.argmax(sums), sums.shape)
    return int(row), int(column)


def _window_sums(values: Floats, size_px: int) -> Floats:
    """Return the sum over each (side, side) window of an image, by its integral."""
    integral = np.pad(values, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    sums: Floats = (
        integral[size_px:, size_px:] - integral[:-size_px, size_px:] - integral[size_px:, :-size_px]
    ) + integral[:-size_px, :-size_px]
    return sums


def _draw_location(
    page: plot_style.Page, exact: Image, row: int, column: int, size_px: int
) -> None:
    over = plot_style.show_image(page, exact, 20, 66, _ZOOM * _DETAIL_PX)
    u, v = (column, column + size_px), (row, row + size_px)
    over.plot([u[0], u[1], u[1], u[0], u[0]], [v[0], v[0], v[1], v[1], v[0]], color=plot_style.RED)
    plot_style.add_text(page, 20, 56, "where", va="bottom", fontweight="bold")


def _caption() -> FigureCaption:
    return FigureCaption(
        title="Jaggings of a straight line",
        caption=(
            f"Where, below the horizon, {_POLYGON_COUNTS[0]} polygons differ most from the exact surface: "
            f"{_DETAIL_PX} × {_DETAIL_PX} pixels, magnified. A straight edge of the world should "
            f"be one smooth curve; facets break it into pieces. With {_POLYGON_COUNTS[1]} polygons the "
            "kinks hardly show."
        ),
        alt=(
            "The frame with a red square, and the square's content three times enlarged: with a "
            "jagged line, with a slightly uneven one, and with a smooth one."
        ),
        metrics={
            "detail_px": _DETAIL_PX,
            "polygons": _POLYGON_COUNTS[0],
            "polygons_finer": _POLYGON_COUNTS[1],
        },
    )
