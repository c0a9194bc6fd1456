"""Deviation of the paper's Eq. 2 from its own mirror, computed without any image.

Eq. 2 is exact for a paraboloid before an orthographic camera. For the hyperboloid before a pinhole
the deviation is h t kappa^2 (t^2 - 1) / (1 - kappa^2 t^2).
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.mirrors.hyperbolic import eq2_radius_ratio_from_t
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.paper_values import PAPER_SIZE_PX


def eq2_deviation_px(camera: OmniCamera, theta_rad: Floats) -> tuple[Floats, Floats]:
    """Exact image radius minus that of Eq. 2, with both ways to scale Eq. 2.

    Args:
        camera: Camera with a mirror of any shape.
        theta_rad: (...) incidence angles from 0 to the camera's rim.

    Returns:
        (...) deviations with the same radius of the horizon, and with the same radius of the rim.
    """
    t = np.tan(0.5 * theta_rad)
    exact = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    eq2 = eq2_radius_ratio_from_t(t)
    # Eq. 2 has no rim of its own: it can be fitted to the mirror at the horizon or at the rim.
    rim_eq2 = float(eq2_radius_ratio_from_t(np.array(camera.rim_t)))
    return exact - camera.horizon_radius_px * eq2, exact - camera.rim_radius_px / rim_eq2 * eq2


def draw_eq2(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw both deviations over the incidence angle."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    rim_deg = math.degrees(camera.rim_rad)
    # The rim itself is appended: rounding may put the last step of arange on either side.
    theta_deg = np.append(np.arange(0.0, rim_deg, 0.25), rim_deg)
    same_h, same_rim = eq2_deviation_px(camera, np.radians(theta_deg))
    axes = plot_style.add_axes(page, 120, 50, 1360, 480)
    axes.axhline(0.0, color=plot_style.BLUE)
    axes.axvline(90.0, color=plot_style.RED, linewidth=0.8)
    axes.plot(theta_deg, same_h, color=plot_style.ORANGE)
    axes.plot(theta_deg, same_rim, color=plot_style.TEAL)
    axes.set(xlim=(0, rim_deg), xticks=np.arange(0, rim_deg + 1, 15))
    # Room for the labels at both extremes.
    axes.margins(y=0.12)
    axes.set_xlabel("incidence angle θ, degrees")
    axes.set_title("exact $r_i$ − Eq. 2, px", loc="left", fontsize=8.5)
    axes.text(89.0, axes.get_ylim()[1], "horizon", color=plot_style.RED, ha="right", va="top")
    _label_maximum(axes, theta_deg, same_h, "same 90° circle", plot_style.ORANGE, "right")
    _label_maximum(axes, theta_deg, same_rim, "same rim", plot_style.TEAL, "left")
    return _caption(rim_deg, same_h, same_rim)


def _label_maximum(
    axes: plot_style.Axes, theta_deg: Floats, deviation: Floats, name: str, colour: str, side: str
) -> None:
    index = int(np.argmax(np.abs(deviation)))
    axes.plot(theta_deg[index], deviation[index], "o", color=colour, markersize=4, clip_on=False)
    axes.annotate(
        f"{name}:\n{abs(deviation[index]):.3f} px at {theta_deg[index]:.0f}°",
        (theta_deg[index], deviation[index]),
        (-9, 0) if side == "right" else (5, 14),
        textcoords="offset points",
        ha=side,
        va="center" if side == "right" else "bottom",
        color=colour,
    )


def _caption(rim_deg: float, same_h: Floats, same_rim: Floats) -> FigureCaption:
    metrics = {
        "rim_deg": round(rim_deg, 3),
        "same_h_max_px": round(float(np.abs(same_h).max()), 4),
        "same_rim_max_px": round(float(np.abs(same_rim).max()), 4),
    }
    return FigureCaption(
        title="Equation 2 against the mirror's own projection",
        caption=(
            "Eq. 2 belongs to a parabolic mirror; the paper's is hyperbolic. In a "
            f"{PAPER_SIZE_PX} px image the two differ by up to {metrics['same_h_max_px']:.3f} px "
            f"with the same 90° circle, by {metrics['same_rim_max_px']:.3f} px with the same rim: "
            "too little to see, enough to measure."
        ),
        alt=(
            "Two curves of the difference in pixels over the incidence angle: one is zero at the "
            "horizon and grows towards the rim, the other is zero at the rim and deepest near "
            "the horizon."
        ),
        metrics=metrics,
    )
