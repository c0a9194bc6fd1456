"""Displacement against the number of polygons: Figure 8's visual comparison in pixels."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.scene.mirror_mesh import Interpolation, tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs, Metrics
from catoptra_studies.camera_figures.polygon_displacement import (
    PolygonError,
    exact_model_error_px,
    measure_polygon_error,
)
from catoptra_studies.paper_values import PAPER_SIZE_PX, POLYGON_COUNTS

# Label, colour and marker of each interpolation.
_INTERPOLATION_STYLES = {
    Interpolation.UV: ("UV, as in the paper", plot_style.ORANGE, "o"),
    Interpolation.POSITION: ("position", plot_style.TEAL, "s"),
}


def draw_polygon_error(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw rms and largest displacement of both interpolations over the number of polygons."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    errors = {
        interpolation: _measure_errors(camera, interpolation) for interpolation in Interpolation
    }
    exact_px = exact_model_error_px(camera)
    axes = plot_style.add_axes(page, 150, 60, 1330, 600)
    axes.set(xscale="log", yscale="log", xlim=(11, 6000), ylim=(2e-6, 300), xlabel="polygons N")
    axes.set_xticks(POLYGON_COUNTS, [str(count) for count in POLYGON_COUNTS])
    axes.minorticks_off()
    axes.set_title(f"displacement in a {PAPER_SIZE_PX} px image", loc="left", fontsize=8.5)
    for interpolation, series in errors.items():
        _draw_interpolation(axes, interpolation, series)
    _draw_reference_lines(axes, errors[Interpolation.POSITION], exact_px)
    axes.legend(loc="center left", bbox_to_anchor=(0.01, 0.42))
    return _caption(errors, exact_px)


def _measure_errors(camera: OmniCamera, interpolation: Interpolation) -> list[PolygonError]:
    return [
        measure_polygon_error(camera, tessellation_from_polygon_count(count, interpolation))
        for count in POLYGON_COUNTS
    ]


def _draw_interpolation(
    axes: plot_style.Axes, interpolation: Interpolation, errors: list[PolygonError]
) -> None:
    name, colour, marker = _INTERPOLATION_STYLES[interpolation]
    rms_px = [error.rms_px for error in errors]
    max_px = [error.max_px for error in errors]
    style = {"color": colour, "markersize": 4}
    axes.plot(POLYGON_COUNTS, rms_px, marker + "-", label=f"{name}: rms", **style)
    axes.plot(
        POLYGON_COUNTS, max_px, marker + ":", mfc=plot_style.BACKGROUND, label=f"{name}: largest",
        **style,
    )  # fmt: skip


def _draw_reference_lines(
    axes: plot_style.Axes, errors: list[PolygonError], exact_px: float
) -> None:
    """Draw a slope of 1/N, the level of one pixel, and the error of the exact model."""
    n = np.array([24.0, 4096.0])
    # Below the measured rms by half, so that the slopes can be compared without overlap.
    line = 0.45 * errors[-1].rms_px * POLYGON_COUNTS[-1] / n
    axes.plot(n, line, color=plot_style.MUTED, linewidth=0.8)
    axes.annotate("O(1/N)", (n[1], line[1]), (0, -4), textcoords="offset points",
                  ha="center", va="top", color=plot_style.MUTED)  # fmt: skip
    axes.axhline(1.0, color=plot_style.FOREGROUND, linewidth=0.6)
    axes.text(12, 1.15, "1 px", va="bottom")
    axes.axhline(exact_px, color=plot_style.BLUE)
    label = f"camera model in every pixel: {_format_power(exact_px)} px"
    axes.text(12, 1.3 * exact_px, label, va="bottom", color=plot_style.BLUE)


def _format_power(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"${mantissa}\cdot10^{{{int(exponent)}}}$"


def _caption(errors: dict[Interpolation, list[PolygonError]], exact_px: float) -> FigureCaption:
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
