"""The frame as a client receives it, with the robot's four sides and the horizon."""

from __future__ import annotations

import math

import numpy as np

from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs

_SIZE_PX = 960
_MARGIN_PX = 100


def draw_omni_frame(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the frame with its 90-degree circle and the robot's sides."""
    subject = inputs.subject
    image = subject.render_frame(_SIZE_PX, samples=2)
    _label_robot_sides(page)
    axes = plot_style.show_image(page, image, _MARGIN_PX, _MARGIN_PX - 30, _SIZE_PX)
    camera = subject.resize_camera(image.shape[0])
    _draw_horizon(axes, camera.centre_px, camera.horizon_radius_px)
    rim_deg = math.degrees(subject.camera.rim_rad)
    return FigureCaption(
        title="The omnidirectional frame",
        caption=(
            "All around the robot in one image. Its centre is straight down, the 90° circle is "
            f"the horizon, the rim is {rim_deg - 90:.0f}° above it. A mirror image is reversed: "
            "with forward up, the robot's left is on the right."
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
    # The label stands in the black corner outside the mirror, joined to the nearest point.
    label = math.radians(135.0)
    line = {
        "arrowstyle": "-",
        "color": plot_style.RED,
        "linewidth": 0.7,
        "shrinkA": 1,
        "shrinkB": 0,
    }
    axes.annotate(
        "90° circle\n(horizon)",
        xy=(centre_px[0] + radius_px * math.cos(label), centre_px[1] + radius_px * math.sin(label)),
        xytext=(0.015, 0.015),
        textcoords="axes fraction",
        color=plot_style.BACKGROUND,
        arrowprops=line,
    )


def _label_robot_sides(page: plot_style.Page) -> None:
    """Write the robot's sides around the image, forward with an arrow."""
    centre = _MARGIN_PX + 0.5 * _SIZE_PX
    height = _MARGIN_PX - 30 + 0.5 * _SIZE_PX
    centred = {"ha": "center", "va": "center"}
    bold = {"fontsize": 10.5, "fontweight": "bold"}
    plot_style.add_text(page, centre, 36, "▲  forward", color=plot_style.RED, **centred, **bold)
    plot_style.add_text(page, centre, _SIZE_PX + 106, "behind", color=plot_style.MUTED, **centred)
    # Exchanged: a mirror reverses the image, and the labels are the robot's own sides.
    for x, text, rotation in ((50, "robot's right", 90), (_SIZE_PX + 150, "robot's left", -90)):
        plot_style.add_text(
            page, x, height, text, color=plot_style.FOREGROUND, rotation=rotation, **centred, **bold
        )
