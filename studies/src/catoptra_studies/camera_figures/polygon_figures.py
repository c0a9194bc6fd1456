"""Displacement of the image by mirror meshes: measured, and drawn as the paper's Figures 8 and 9.

The direction that a covered pixel looks up is projected by the camera model, in float64: the
distance between that projection and the pixel is the error. Figure 8 is the frame through four
meshes at 360 x 360 pixels; maps and a curve over the number of polygons have the numbers.

Figure 9 is a straight line through 256 polygons in magnified detail. The detail is found, not
chosen: the window below the horizon, on the floor with lines, in which the coarser mesh differs
most from the exact mirror.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.world.mirror_mesh import (
    Interpolation,
    Tessellation,
    tessellation_from_polygon_count,
)
from catoptra_studies.camera_figures.figure_spec import (
    FIGURE_SAMPLES,
    FigureCaption,
    FigureInputs,
    Metrics,
)
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX, POLYGON_COUNTS
from catoptra_studies.plot_style import (
    BACKGROUND,
    BLUE,
    FOREGROUND,
    MUTED,
    ORANGE,
    TEAL,
    Axes,
    Image,
    Page,
    add_axes,
    add_text,
    draw_colour_bar,
    map_error_colours,
    outline_square,
    show_image,
)

# A polygon may look up directions beyond the rim. The same mirror with a wider rim projects those,
# up to this fraction of the angle at which the image radius goes to infinity.
_ASYMPTOTE_FRACTION = 0.999


@dataclass(frozen=True, slots=True)
class _PolygonError:
    """Displacement over all pixels with a polygon at their centre."""

    tessellation: Tessellation
    rms_px: float
    max_px: float

    coverage: float
    """Fraction of the mirror's disc that the polygons cover."""


def measure_polygon_error(camera: OmniCamera, tessellation: Tessellation) -> _PolygonError:
    """Measure the displacement by one mesh in a camera's image."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, is_valid = displacement_px(camera, pixels, directions)
    _, is_on_disc = direction_from_pixel(camera, pixels)
    errors_px = error_px[is_covered & is_valid]
    return _PolygonError(
        tessellation=tessellation,
        rms_px=float(np.sqrt(np.mean(np.square(errors_px)))),
        max_px=float(errors_px.max()),
        coverage=float(is_covered.sum() / is_on_disc.sum()),
    )


def _exact_model_error_px(camera: OmniCamera) -> float:
    """Largest error where the camera model is evaluated in every pixel.

    Trace casts rays in float32, so their directions are rounded; the model itself is float64.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_on_disc = direction_from_pixel(camera, pixels)
    rounded = directions.astype(np.float32).astype(np.float64)
    error_px, is_valid = displacement_px(camera, pixels, rounded)
    return float(error_px[is_on_disc & is_valid].max())


def displacement_px(camera: OmniCamera, pixels: Floats, directions: Floats) -> tuple[Floats, Bools]:
    """Distance between pixels and the projections of the directions shown there.

    Args:
        camera: Camera of the image.
        pixels: (..., 2) positions in the image.
        directions: (..., 3) directions looked up at these positions, in the mirror frame.

    Returns:
        (...) distances, and the mask of directions that have a projection.
    """
    # At 89 degrees of theta/2 even a mirror without asymptote ends; tan grows without limit there.
    t_limit = min(camera.projection.t_limit, math.tan(math.radians(89.0)))
    wide = dataclasses.replace(camera, rim_rad=_ASYMPTOTE_FRACTION * 2.0 * math.atan(t_limit))
    projections, is_valid = pixel_from_direction(wide, directions)
    return np.linalg.norm(projections - pixels, axis=-1), is_valid


def displacement_map(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """(h, w) displacement of each pixel's content in pixels; nan where no polygon is."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, is_valid = displacement_px(camera, pixels, directions)
    return np.where(is_covered & is_valid, error_px, np.nan)


# Each rendered pixel becomes a block of 2 x 2: no resampling hides or adds a step in a line.
_IMAGE_WIDTH_PX = 2 * PAPER_SIZE_PX
_FRAMES_LEFT_PX, _FRAMES_TOP_PX, _STEP_X_PX, _STEP_Y_PX = 20, 66, 760, 790


def draw_polygon_frames(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the four frames, each under the measured displacement."""
    subject = inputs.subject
    camera = subject.resize_camera(PAPER_SIZE_PX)
    # UV coordinates, the default of a tessellation, as in the paper.
    errors = [
        measure_polygon_error(camera, tessellation_from_polygon_count(count))
        for count in PAPER_POLYGON_COUNTS
    ]
    for index, error in enumerate(errors):
        left = _FRAMES_LEFT_PX + _STEP_X_PX * (index % 2)
        top = _FRAMES_TOP_PX + _STEP_Y_PX * (index // 2)
        image = subject.render_frame(PAPER_SIZE_PX, FIGURE_SAMPLES, surface=error.tessellation)
        show_image(page, image, left, top, _IMAGE_WIDTH_PX)
        _draw_heading(page, left, top, error)
    return _caption_frames(errors)


def _draw_heading(page: Page, left: int, top: int, error: _PolygonError) -> None:
    name = f"{error.tessellation.num_polygons} polygons"
    add_text(page, left, top - 12, name, va="bottom", fontweight="bold")
    numbers = f"{error.rms_px:.3g} px rms, {error.max_px:.3g} px at most"
    right = left + _IMAGE_WIDTH_PX
    add_text(page, right, top - 12, numbers, ha="right", va="bottom", color=MUTED)


def _caption_frames(errors: list[_PolygonError]) -> FigureCaption:
    metrics = {}
    for error in errors:
        metrics[f"rms_px_{error.tessellation.num_polygons}"] = round(error.rms_px, 3)
        metrics[f"max_px_{error.tessellation.num_polygons}"] = round(error.max_px, 3)
    coarse, *_, fine = errors
    return FigureCaption(
        title="The same view through 16, 64, 256 and 1024 polygons",
        caption=(
            f"UV-mapped mirror meshes in {PAPER_SIZE_PX} × {PAPER_SIZE_PX} pixels, shown pixel "
            "by pixel. Texture coordinates are interpolated linearly over each polygon, which "
            f"displaces the image by {coarse.rms_px:.1f} px (rms) with "
            f"{coarse.tessellation.num_polygons} polygons and by {fine.rms_px:.2f} px with "
            f"{fine.tessellation.num_polygons}."
        ),
        alt=(
            "Four round mirror images of the same scene: with 16 polygons a broken square, with "
            "64 an octagon with bent lines, with 256 nearly right, with 1024 smooth."
        ),
        metrics=metrics,
    )


DISPLACEMENT_RANGE_PX = (0.1, 100.0)
# White would look like no error where no polygon is.
_EMPTY_GREY = 226
_MAPS_LEFT_PX, _MAPS_TOP_PX, _STEP_PX = 10, 56, PAPER_SIZE_PX + 20


def draw_polygon_maps(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the displacement of each pixel by four meshes, with one colour scale."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    below_1px: Metrics = {}
    for index, count in enumerate(PAPER_POLYGON_COUNTS):
        left = _MAPS_LEFT_PX + index * _STEP_PX
        error_px = displacement_map(camera, tessellation_from_polygon_count(count))
        add_text(page, left, _MAPS_TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold")
        show_image(page, colour_displacement(error_px), left, _MAPS_TOP_PX, PAPER_SIZE_PX)
        covered = error_px[~np.isnan(error_px)]
        below_1px[f"below_1px_{count}_percent"] = round(100.0 * float((covered < 1.0).mean()), 1)
    draw_colour_bar(
        page, DISPLACEMENT_RANGE_PX, left=820, top=_MAPS_TOP_PX + PAPER_SIZE_PX + 30, width=480,
        ticks=(0.1, 1, 10, 100), title="displacement, px; grey: no polygon",
    )  # fmt: skip
    return _caption_maps(below_1px)


def colour_displacement(error_px: Floats) -> Image:
    """(h, w, 3) colours of a map of displacements, grey for nan."""
    colours = map_error_colours(np.nan_to_num(error_px), *DISPLACEMENT_RANGE_PX)
    colours[np.isnan(error_px)] = _EMPTY_GREY
    return colours


def _caption_maps(metrics: Metrics) -> FigureCaption:
    coarse, fine = PAPER_POLYGON_COUNTS[0], PAPER_POLYGON_COUNTS[-1]
    return FigureCaption(
        title="Where the meshes displace the image",
        caption=(
            "The same meshes: how far the content of each pixel is from its place in the exact "
            "image. Corners of polygons are right, their middles are not. Displaced by "
            f"less than a pixel are {metrics[f'below_1px_{coarse}_percent']:.1f} % of the pixels "
            f"with {coarse} polygons and {metrics[f'below_1px_{fine}_percent']:.1f} % with {fine}."
        ),
        alt=(
            "Four round maps of errors from dark red with 16 polygons to almost white with 1024; "
            "the pattern of the polygons shows in each."
        ),
        metrics=metrics,
    )


# Label, colour and marker of each interpolation.
_INTERPOLATION_STYLES = {
    Interpolation.UV: ("UV, as in the paper", ORANGE, "o"),
    Interpolation.POSITION: ("position", TEAL, "s"),
}


def draw_polygon_error(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw rms and largest displacement of both interpolations over the number of polygons."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    errors = {
        interpolation: [
            measure_polygon_error(camera, tessellation_from_polygon_count(count, interpolation))
            for count in POLYGON_COUNTS
        ]
        for interpolation in Interpolation
    }
    exact_px = _exact_model_error_px(camera)
    axes = add_axes(page, 150, 60, 1330, 600)
    axes.set(xscale="log", yscale="log", xlim=(11, 6000), ylim=(2e-6, 300), xlabel="polygons N")
    axes.set_xticks(POLYGON_COUNTS, [str(count) for count in POLYGON_COUNTS])
    axes.minorticks_off()
    axes.set_title(f"displacement in a {PAPER_SIZE_PX} px image", loc="left", fontsize=8.5)
    for interpolation, series in errors.items():
        _draw_interpolation(axes, interpolation, series)
    _draw_reference_lines(axes, errors[Interpolation.POSITION], exact_px)
    axes.legend(loc="center left", bbox_to_anchor=(0.01, 0.42))
    return _caption_errors(errors, exact_px)


def _draw_interpolation(
    axes: Axes, interpolation: Interpolation, errors: list[_PolygonError]
) -> None:
    name, colour, marker = _INTERPOLATION_STYLES[interpolation]
    rms_px = [error.rms_px for error in errors]
    max_px = [error.max_px for error in errors]
    style = {"color": colour, "markersize": 4}
    axes.plot(POLYGON_COUNTS, rms_px, marker + "-", label=f"{name}: rms", **style)
    axes.plot(
        POLYGON_COUNTS, max_px, marker + ":", mfc=BACKGROUND, label=f"{name}: largest",
        **style,
    )  # fmt: skip


def _draw_reference_lines(axes: Axes, errors: list[_PolygonError], exact_px: float) -> None:
    """Draw a slope of 1/N, the level of one pixel, and the error of the exact model."""
    n = np.array([24.0, 4096.0])
    # Below the measured rms by half, so that the slopes can be compared without overlap.
    line = 0.45 * errors[-1].rms_px * POLYGON_COUNTS[-1] / n
    axes.plot(n, line, color=MUTED, linewidth=0.8)
    axes.annotate("O(1/N)", (n[1], line[1]), (0, -4), textcoords="offset points",
                  ha="center", va="top", color=MUTED)  # fmt: skip
    axes.axhline(1.0, color=FOREGROUND, linewidth=0.6)
    axes.text(12, 1.15, "1 px", va="bottom")
    axes.axhline(exact_px, color=BLUE)
    label = f"camera model in every pixel: {_format_power(exact_px)} px"
    axes.text(12, 1.3 * exact_px, label, va="bottom", color=BLUE)


def _format_power(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"${mantissa}\cdot10^{{{int(exponent)}}}$"


def _caption_errors(
    errors: dict[Interpolation, list[_PolygonError]], exact_px: float
) -> FigureCaption:
    metrics: Metrics = {"exact_model_max_px": float(f"{exact_px:.2g}")}
    for interpolation, series in errors.items():
        for error in series:
            key = f"{interpolation.value}_{error.tessellation.num_polygons}"
            metrics[f"{key}_rms_px"] = round(error.rms_px, 4)
            metrics[f"{key}_max_px"] = round(error.max_px, 4)
            metrics[f"{key}_coverage"] = round(error.coverage, 3)
    uv = errors[Interpolation.UV]
    # The coarsest mesh within a pixel is the one to recommend; the finest where none is.
    subpixel = next((error for error in uv if error.rms_px < 1.0), uv[-1])
    return FigureCaption(
        title="Error falls as one over the number of polygons",
        caption=(
            "Measured displacement over all covered pixels. Four times the polygons, a quarter of "
            f"the error: with {subpixel.tessellation.num_polygons} the paper's UV mapping is "
            f"{subpixel.rms_px:.2f} px off (rms). The camera model, evaluated in every pixel, is "
            f"{exact_px:.1g} px off: the rounding of its rays to single precision."
        ),
        alt=(
            "Straight falling lines on logarithmic axes for two ways of interpolation, parallel "
            "to one over N, and far below them the level of the exact camera model."
        ),
        metrics=metrics,
    )


_DETAIL_PX = 44
_ZOOM = 8
_COARSE, _FINE = 256, 1024


def draw_polygon_detail(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the location in the frame, and the detail through two meshes and the exact mirror."""
    subject = inputs.subject
    exact = subject.render_frame(PAPER_SIZE_PX, FIGURE_SAMPLES)
    meshes = [
        subject.render_frame(
            PAPER_SIZE_PX, FIGURE_SAMPLES, surface=tessellation_from_polygon_count(count)
        )
        for count in (_COARSE, _FINE)
    ]
    # Tests render smaller frames, with a smaller detail.
    size_px = round(_DETAIL_PX * exact.shape[0] / PAPER_SIZE_PX)
    radius_px = subject.resize_camera(exact.shape[0]).horizon_radius_px
    row, column = find_max_difference_window(meshes[0], exact, size_px, max_radius_px=radius_px)
    axes = show_image(page, exact, 20, 66, _ZOOM * _DETAIL_PX)
    outline_square(axes, row, column, size_px)
    add_text(page, 20, 56, "location", va="bottom", fontweight="bold")
    names = (f"{_COARSE} polygons", f"{_FINE} polygons", "exact surface")
    for index, (name, image) in enumerate(zip(names, (*meshes, exact), strict=True)):
        left = 400 + index * (_ZOOM * _DETAIL_PX + 20)
        add_text(page, left, 56, name, va="bottom", fontweight="bold")
        detail = image[row : row + size_px, column : column + size_px]
        show_image(page, detail, left, 66, _ZOOM * _DETAIL_PX)
    return _caption_detail()


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
    # Only the central half of a window counts, so that the difference lies well inside.
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


def _caption_detail() -> FigureCaption:
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
