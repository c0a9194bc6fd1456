"""How far the paper's Eq. 2 is from its own mirror: computed, no picture involved.

Eq. 2 is exact for a paraboloid before an orthographic camera. For the hyperboloid before a pinhole
it departs by h t kappa^2 (t^2 - 1) / (1 - kappa^2 t^2).
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.mirrors.hyperbolic import eq2_radius_ratio_from_t
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX, FigureSubject


def eq2_deviation_px(camera: OmniCamera, theta_rad: Floats) -> tuple[Floats, Floats]:
    """Return exact minus Eq. 2 at (...) incidence angles: with the same h, and the same rim.

    Domain: 0 <= theta <= the camera's rim.
    """
    t = np.tan(0.5 * theta_rad)
    exact = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
    eq2 = eq2_radius_ratio_from_t(t)
    rim_eq2 = float(eq2_radius_ratio_from_t(np.array(camera.rim_t)))
    return exact - camera.horizon_radius_px * eq2, exact - camera.rim_radius_px / rim_eq2 * eq2


def draw(page: plot_style.Page, subject: FigureSubject) -> FigureCaption:
    """Draw both departures over the incidence angle."""
    camera = subject.resize_camera(PAPER_SIZE_PX)
    rim_deg = math.degrees(camera.rim_rad)
    theta_deg = np.append(np.arange(0.0, rim_deg, 0.25), rim_deg)
    same_h, same_rim = eq2_deviation_px(camera, np.radians(theta_deg))
    on = plot_style.add_axes(page, 120, 50, 1360, 480)
    on.axhline(0.0, color=plot_style.BLUE)
    on.axvline(90.0, color=plot_style.RED, linewidth=0.8)
    on.plot(theta_deg, same_h, color=plot_style.ORANGE)
    on.plot(theta_deg, same_rim, color=plot_style.TEAL)
    on.set(xlim=(0, rim_deg), xticks=np.arange(0, rim_deg + 1, 15))
    on.margins(y=0.12)
    on.set_xlabel("incidence angle θ, degrees")
    on.set_title("exact $r_i$ − Eq. 2, px", loc="left", fontsize=8.5)
    on.text(89.0, on.get_ylim()[1], "horizon", color=plot_style.RED, ha="right", va="top")
    _label_maximum(on, theta_deg, same_h, "same 90° circle", plot_style.ORANGE, "right")
    _label_maximum(on, theta_deg, same_rim, "same rim", plot_style.TEAL, "left")
    return _caption(rim_deg, same_h, same_rim)


def _label_maximum(
    axes: plot_style.Axes, theta_deg: Floats, deviation: Floats, name: str, colour: str, side: str
) -> None:
    at = int(np.argmax(np.abs(deviation)))
    axes.plot(theta_deg[at], deviation[at], "o", color=colour, markersize=4, clip_on=False)
    axes.annotate(
        f"{name}:\n{abs(deviation[at]):.3f} px at {theta_deg[at]:.0f}°",
        (theta_deg[at], deviation[at]),
        (-9, 0) if side == "right" else (5, 14),
        textcoords="offset points",
        ha=side,
        va="center" if side == "right" else "bottom",
        color=colour,
    )


def _caption(rim_deg: float, same_h: Floats, same_rim: Floats) -> FigureCaption:
    numbers = {
        "rim_deg": round(rim_deg, 3),
        "same_h_max_px": round(float(np.abs(same_h).max()), 4),
        "same_rim_max_px": round(float(np.abs(same_rim).max()), 4),
    }
    return FigureCaption(
        title="Equation 2 against the mirror's own law",
        caption=(
            "Eq. 2 belongs to a parabolic mirror; the paper's is hyperbolic. In a "
            f"{PAPER_SIZE_PX} px image the two differ by up to {numbers['same_h_max_px']:.3f} px "
            f"with the same 90° circle, by {numbers['same_rim_max_px']:.3f} px with the same rim: "
            "too little to see, enough to measure."
        ),
        alt=(
            "Two curves of the difference in pixels over the incidence angle: one is zero at the "
            "horizon and grows towards the rim, the other is zero at the rim and deepest near "
            "the horizon."
        ),
        metrics=numbers,
    )
