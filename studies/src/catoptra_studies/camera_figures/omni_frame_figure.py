"""The frame as a client receives it, with what a roboticist asks first: where is left, where up."""

from __future__ import annotations

import math

import numpy as np

from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption
from catoptra_studies.camera_figures.figure_subject import FigureSubject

_SIZE_PX = 960
_MARGIN_PX = 100


def draw(page: plot_style.Page, subject: FigureSubject) -> FigureCaption:
    """Draw the frame with its 90-degree circle and the robot's four sides."""
    image = subject.render_frame(_SIZE_PX, samples=2)
    _label_robot_sides(page)
    over = plot_style.show_image(page, image, _MARGIN_PX, _MARGIN_PX - 30, _SIZE_PX)
    camera = subject.resize_camera(image.shape[0])
    _draw_horizon(over, camera.centre_px, camera.horizon_radius_px)
    rim_deg = math.degrees(subject.camera.rim_rad)
    return FigureCaption(
        title="The omnidirectional frame",
        caption=(
            "All around the robot in one picture. Its centre is straight down, the 90° circle is "
            f"the horizon, the rim looks {rim_deg - 90:.0f}° above it. What a mirror shows is "
            "mirrored: with forward up, the robot's left is on the right."
        ),
        alt=(
            "A round mirror image of the world around the robot on a black square, with the "
            "horizon as a thin red circle, an arrow for forward, and left and right exchanged."
        ),
        metrics={"rim_deg": round(rim_deg, 3), "above_horizon_deg": round(rim_deg - 90.0, 3)},
    )


def _draw_horizon(axes: plot_style.Axes, centre_px: tuple[float, float], radius_px: float) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    u = centre_px[0] + radius_px * np.cos(angle)
    v = centre_px[1] + radius_px * np.sin(angle)
    axes.plot(u, v, color=plot_style.RED, linewidth=0.7)
    at = math.radians(135.0)
    axes.annotate(
        "90° circle\n(horizon)",
        xy=(centre_px[0] + radius_px * math.cos(at), centre_px[1] + radius_px * math.sin(at)),
        xytext=(0.015, 0.015),
        textcoords="axes fraction",
        color=plot_style.BACKGROUND,
        arrowprops={
            "arrowstyle": "-",
            "color": plot_style.RED,
            "linewidth": 0.7,
            "shrinkA": 1,
            "shrinkB": 0,
        },
    )


def _label_robot_sides(page: plot_style.Page) -> None:
    """Write the robot's sides around the picture, forward with an arrow."""
    middle = _MARGIN_PX + 0.5 * _SIZE_PX
    height = _MARGIN_PX - 30 + 0.5 * _SIZE_PX
    centred = {"ha": "center", "va": "center"}
    strong = {"fontsize": 10.5, "fontweight": "bold"}
    plot_style.add_text(page, middle, 36, "▲  forward", color=plot_style.RED, **centred, **strong)
    plot_style.add_text(page, middle, _SIZE_PX + 106, "behind", color=plot_style.MUTED, **centred)
    for x, text, turn in ((50, "robot's right", 90), (_SIZE_PX + 150, "robot's left", -90)):
        plot_style.add_text(
            page, x, height, text, color=plot_style.FOREGROUND, rotation=turn, **centred, **strong
        )
