"""Incidence angles rendered as circles and measured: the paper's Figure 7.

The paper says that such an image concurs with Eq. 2. Measured in pixels it follows the camera
model; Eq. 2 stays within a pixel of both, and the figure shows the deviation.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.mirrors.hyperbolic import eq2_radius_ratio_from_t
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.camera_figures.ring_radii import NUM_SECTORS, measure_ring_radii
from catoptra_studies.paper_values import PAPER_SIZE_PX

# The world has a circle every five degrees, the first at five.
_SPACING_DEG = 5.0
# A ring is hardly wider than a pixel, and its radius is measured to 0.02 px.
_SAMPLES = 6
_IMAGE_WIDTH_PX = 2 * PAPER_SIZE_PX


def draw_rings(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the rings, their measured radii, and the deviations from camera model and Eq. 2."""
    # Always at the paper's size: the radii are measured in pixels.
    image = inputs.rings.render_frame(PAPER_SIZE_PX, _SAMPLES)
    camera = inputs.rings.resize_camera(PAPER_SIZE_PX)
    measured = measure_ring_radii(image, rim_radius_px=camera.rim_radius_px)
    theta_deg = _SPACING_DEG * np.arange(1, measured.shape[1] + 1)
    t = np.tan(np.radians(0.5 * theta_deg))
    exact = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    eq2 = camera.horizon_radius_px * eq2_radius_ratio_from_t(t)
    axes = plot_style.show_image(page, image, 20, 40, _IMAGE_WIDTH_PX)
    _label_rings(axes, theta_deg, exact)
    _draw_radii(page, theta_deg, measured, exact)
    _draw_deviations(page, theta_deg, measured - exact, eq2 - exact)
    return _caption(theta_deg, measured, exact, eq2)


def _label_rings(axes: plot_style.Axes, theta_deg: Floats, radius_px: Floats) -> None:
    centre = 0.5 * PAPER_SIZE_PX
    diagonal = math.cos(math.radians(-45)), math.sin(math.radians(-45))
    box = {"facecolor": plot_style.BACKGROUND, "edgecolor": "none", "pad": 0.8}
    for theta, radius in zip(theta_deg, radius_px, strict=True):
        # A number at every ring would hide the rings.
        if theta % 30 == 0:
            colour = plot_style.RED if theta == 90 else plot_style.FOREGROUND
            axes.text(
                centre + radius * diagonal[0], centre + radius * diagonal[1], f"{theta:.0f}°",
                ha="center", va="center", fontsize=7.5, color=colour, bbox=box,
            )  # fmt: skip


def _draw_radii(page: plot_style.Page, theta_deg: Floats, measured: Floats, exact: Floats) -> None:
    axes = plot_style.add_axes(page, 860, 60, 620, 320)
    axes.plot(theta_deg, exact, color=plot_style.BLUE, label="camera model")
    points = {"color": plot_style.FOREGROUND, "markersize": 2.6}
    axes.plot(theta_deg, measured.mean(axis=0), "o", label="measured", **points)
    axes.axvline(90.0, color=plot_style.RED, linewidth=0.8)
    axes.set(xlim=(0, 120), ylim=(0, 180), xticks=range(0, 121, 30), yticks=range(0, 181, 60))
    axes.set_title("image radius $r_i$, px", loc="left", fontsize=8.5)
    axes.tick_params(labelbottom=False)
    axes.legend(loc="upper left")


def _draw_deviations(
    page: plot_style.Page, theta_deg: Floats, measured_deviation: Floats, eq2_deviation: Floats
) -> None:
    axes = plot_style.add_axes(page, 860, 460, 620, 250)
    # The band spans all sectors of a ring, the points are their means.
    low, high = measured_deviation.min(axis=0), measured_deviation.max(axis=0)
    axes.fill_between(theta_deg, low, high, color=plot_style.LIGHT_GREY, linewidth=0)
    points = {"color": plot_style.FOREGROUND, "markersize": 2.6}
    axes.plot(theta_deg, measured_deviation.mean(axis=0), "o", **points)
    axes.plot(theta_deg, eq2_deviation, "--", color=plot_style.ORANGE)
    axes.axhline(0.0, color=plot_style.BLUE)
    axes.axvline(90.0, color=plot_style.RED, linewidth=0.8)
    axes.set(xlim=(0, 120), xticks=range(0, 121, 30), xlabel="incidence angle θ, degrees")
    axes.set_title("deviation from the camera model, px", loc="left", fontsize=8.5)
    axes.annotate("Eq. 2", (theta_deg[-1], eq2_deviation[-1]), (-8, 0),
                  textcoords="offset points", ha="right", color=plot_style.ORANGE)  # fmt: skip
    axes.annotate("measured", (45.0, measured_deviation.min()), (0, -3),
                  textcoords="offset points", ha="center", va="top")  # fmt: skip


def _caption(theta_deg: Floats, measured: Floats, exact: Floats, eq2: Floats) -> FigureCaption:
    rings = measured.mean(axis=0)
    metrics = {
        "rings": len(theta_deg),
        "sectors": NUM_SECTORS,
        "eq2_worst_deg": float(theta_deg[np.argmax(np.abs(rings - eq2))]),
        "exact_max_px": round(float(np.abs(rings - exact).max()), 3),
        "exact_max_of_any_sector_px": round(float(np.abs(measured - exact).max()), 3),
        "eq2_max_px": round(float(np.abs(rings - eq2).max()), 3),
    }
    return FigureCaption(
        title="Incidence angles, rendered and measured",
        caption=(
            f"A circle every 5° of incidence, red at 90°. The radii of {metrics['rings']} rings, "
            f"measured in the pixels of this {PAPER_SIZE_PX} px image, lie within "
            f"{metrics['exact_max_px']:.3f} px of the camera model (any of {NUM_SECTORS} "
            f"sectors: {metrics['exact_max_of_any_sector_px']:.3f} px, grey) and up to "
            f"{metrics['eq2_max_px']:.3f} px from the paper's Eq. 2, at "
            f"{metrics['eq2_worst_deg']:.0f}°."
        ),
        alt=(
            "Concentric rings in the mirror, the 90 degree one red; beside it the measured radii "
            "on the camera model's curve, and below the small deviations: measured around zero, "
            "Eq. 2 bending away beyond 90 degrees."
        ),
        metrics=metrics,
    )
