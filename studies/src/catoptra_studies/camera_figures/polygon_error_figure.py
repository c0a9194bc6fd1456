"""Error against number of polygons: what the impressions of Figure 8 come to in pixels."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.scene.mirror_mesh import Interpolation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, Metrics
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX, FigureSubject
from catoptra_studies.camera_figures.polygon_displacement import (
    PolygonError,
    exact_model_error_px,
    measure_polygon_error,
)

POLYGON_COUNTS = (16, 64, 256, 1024, 4096)
_INTERPOLATION_STYLES = {
    Interpolation.UV: ("UV, as in the paper", plot_style.ORANGE, "o"),
    Interpolation.POSITION: ("position", plot_style.TEAL, "s"),
}


def draw(page: plot_style.Page, subject: FigureSubject) -> FigureCaption:
    """Draw rms and largest error of both interpolations, with O(1/N) and the exact law's level."""
    camera = subject.resize_camera(PAPER_SIZE_PX)
    errors = {way: _measure_errors(camera, way) for way in Interpolation}
    floor_px = exact_model_error_px(camera)
    on = plot_style.add_axes(page, 150, 60, 1330, 600)
    on.set(xscale="log", yscale="log", xlim=(11, 6000), ylim=(2e-6, 300), xlabel="polygons N")
    on.set_xticks(POLYGON_COUNTS, [str(count) for count in POLYGON_COUNTS])
    on.minorticks_off()
    on.set_title(f"displacement in a {PAPER_SIZE_PX} px image", loc="left", fontsize=8.5)
    for way, of_way in errors.items():
        _draw_interpolation(on, way, of_way)
    _draw_reference_lines(on, errors[Interpolation.POSITION], floor_px)
    on.legend(loc="center left", bbox_to_anchor=(0.01, 0.42))
    return _caption(errors, floor_px)


def _measure_errors(camera: OmniCamera, interpolation: Interpolation) -> list[PolygonError]:
    return [
        measure_polygon_error(camera, tessellation_from_polygon_count(count, interpolation))
        for count in POLYGON_COUNTS
    ]


def _draw_interpolation(
    axes: plot_style.Axes, interpolation: Interpolation, errors: list[PolygonError]
) -> None:
    name, colour, marker = _INTERPOLATION_STYLES[interpolation]
    rms = [error.rms_px for error in errors]
    largest = [error.max_px for error in errors]
    axes.plot(POLYGON_COUNTS, rms, marker + "-", color=colour, markersize=4, label=f"{name}: rms")
    axes.plot(
        POLYGON_COUNTS, largest, marker + ":", color=colour, markersize=4, mfc=plot_style.BACKGROUND,
        label=f"{name}: largest",
    )  # fmt: skip


def _draw_reference_lines(
    axes: plot_style.Axes, errors: list[PolygonError], floor_px: float
) -> None:
    """Draw O(1/N) a little under the measured rms, one pixel, and what the exact law leaves."""
    n = np.array([24.0, 4096.0])
    axes.plot(
        n, 0.45 * errors[-1].rms_px * POLYGON_COUNTS[-1] / n, color=plot_style.MUTED, linewidth=0.8
    )
    axes.annotate("O(1/N)", (n[1], 0.45 * errors[-1].rms_px), (0, -4), textcoords="offset points",
                ha="center", va="top", color=plot_style.MUTED)  # fmt: skip
    axes.axhline(1.0, color=plot_style.FOREGROUND, linewidth=0.6)
    axes.text(12, 1.15, "1 px", va="bottom")
    axes.axhline(floor_px, color=plot_style.BLUE)
    axes.text(12, 1.3 * floor_px, f"exact law in every pixel: {_format_power(floor_px)} px",
            va="bottom", color=plot_style.BLUE)  # fmt: skip


def _format_power(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"${mantissa}\cdot10^{{{int(exponent)}}}$"


def _caption(errors: dict[Interpolation, list[PolygonError]], floor_px: float) -> FigureCaption:
    numbers: Metrics = {"exact_law_max_px": float(f"{floor_px:.2g}")}
    for way, of_way in errors.items():
        for error in of_way:
            key = f"{way.value}_{error.tessellation.num_polygons}"
            numbers[f"{key}_rms_px"] = round(error.rms_px, 4)
            numbers[f"{key}_max_px"] = round(error.max_px, 4)
            numbers[f"{key}_covered"] = round(error.coverage, 3)
    uv = errors[Interpolation.UV]
    enough = next((error for error in uv if error.rms_px < 1.0), uv[-1])
    return FigureCaption(
        title="Error falls as one over the number of polygons",
        caption=(
            "Measured displacement over all covered pixels. Four times the polygons, a quarter of "
            f"the error: with {enough.tessellation.num_polygons} the paper's UV mapping is "
            f"{enough.rms_px:.2f} px off (rms). The exact law, evaluated in every pixel, leaves "
            f"{floor_px:.1g} px: the rounding of its rays to single precision."
        ),
        alt=(
            "Straight falling lines on logarithmic axes for two ways of interpolation, parallel "
            "to one over N, and far below them the level of the exact law."
        ),
        metrics=numbers,
    )
