"""Images of the virtual cameras and of the capture camera: the paper's Figures 5 and 1.

The views of the five virtual cameras are unfolded: the four sides form a row in which the panorama
runs on across the borders; the view down hangs under the forward one. The part beyond the mirror's
rim is dimmed. The frame is shown as a client receives it, with the robot's sides and the horizon.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Bools
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.plot_style import (
    BACKGROUND,
    FOREGROUND,
    LIGHT_GREY,
    MUTED,
    RED,
    Axes,
    Image,
    Page,
    add_pixel_axes,
    add_text,
    label_box,
    show_image,
)
from catoptra_studies.study_subject import StudySubject

FACES = (Face.W, Face.N, Face.E, Face.S, Face.C)
_FACE_TITLES = {
    Face.N: "N  forward",
    Face.E: "E  right",
    Face.S: "S  behind",
    Face.W: "W  left",
    Face.C: "C  down",
}
# Four faces and two margins fill a page of 1520 px.
_FACE_SIZE_PX = 370
_LEFT_PX = 20
_TOP_PX = 20
_DIM_COLOUR = np.array([70.0, 84.0, 98.0])


def draw_faces(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the unfolded cube, and the directions of the cameras."""
    subject = inputs.subject
    for face in FACES:
        image = subject.render_face(face, _FACE_SIZE_PX, samples=3)
        mask = _visible_mask(face, image.shape[0], subject.camera.rim_rad)
        # The view down hangs under the forward one, in column 1.
        column = 1 if face == Face.C else FACES.index(face)
        left = _LEFT_PX + column * _FACE_SIZE_PX
        top = _TOP_PX + (_FACE_SIZE_PX if face == Face.C else 0)
        dimmed = _dim_hidden_pixels(image, mask)
        axes = show_image(page, dimmed, left, top, _FACE_SIZE_PX)
        _outline_face(axes, face, image.shape[0])
    _draw_explanation(page, math.degrees(subject.camera.rim_rad))
    return _caption_faces(subject)


def _dim_hidden_pixels(image: Image, mask: Bools) -> Image:
    """Blend all pixels outside a (h, w) mask towards a cool grey."""
    dimmed = (0.4 * image + 0.6 * _DIM_COLOUR).astype(np.uint8)
    return np.where(mask[..., None], image, dimmed)


def _visible_mask(face: Face, size_px: int, rim_rad: float) -> Bools:
    """(size, size) pixels of a face with an incidence angle within the mirror's rim."""
    steps = 2.0 * (np.arange(size_px) + 0.5) / size_px - 1.0
    t, s = np.meshgrid(steps, steps, indexing="ij")
    direction = np.stack((np.ones_like(s), s, t), axis=-1) @ MIRROR_FROM_FACE_ROTATIONS[face].T
    # cos theta, since the axis is +z; cosines fall with theta, hence >=.
    cosine = direction[..., 2] / np.linalg.norm(direction, axis=-1)
    is_visible: Bools = cosine >= math.cos(rim_rad)
    return is_visible


def _outline_face(axes: Axes, face: Face, size_px: int) -> None:
    """Draw border and name of a face, and the horizon on the sides."""
    u, v = [0, size_px, size_px, 0, 0], [0, 0, size_px, size_px, 0]
    axes.plot(u, v, color=FOREGROUND, linewidth=0.8, clip_on=False)
    if face != Face.C:
        axes.plot([0, size_px], [0.5 * size_px] * 2, color=RED, linewidth=0.7)
    box = label_box(2.5)
    margin = 0.035 * size_px
    axes.text(margin, margin, _FACE_TITLES[face], va="top", fontweight="bold", bbox=box)


def _draw_explanation(page: Page, rim_deg: float) -> None:
    left, top = _LEFT_PX + 2 * _FACE_SIZE_PX, _TOP_PX + _FACE_SIZE_PX
    size = _FACE_SIZE_PX - 40
    _draw_camera_layout(add_pixel_axes(page, left + 20, top + 20, size, size))
    x = left + _FACE_SIZE_PX
    layout = "from above: four level cameras\nof 90°; the fifth looks down"
    add_text(page, x, top + 80, layout)
    add_text(page, x, top + 180, "horizon, θ = 90°", color=RED)
    dimmed = f"dimmed: above θ = {rim_deg:.0f}°,\nbeyond the mirror's rim"
    add_text(page, x, top + 240, dimmed, color=MUTED)


def _draw_camera_layout(axes: Axes) -> None:
    """Draw the fields of view of the four level cameras from above, forward up."""
    half = 0.5 * axes.get_xlim()[1]
    reach = 0.92 * half
    corners = np.array([[-1.0, -1.0], [1.0, -1.0]]) * reach
    for turns, name in enumerate("NESW"):
        # Quarter turns have exact cosines, so no corner leaves the square by rounding.
        c, s = round(math.cos(turns * math.pi / 2)), round(math.sin(turns * math.pi / 2))
        wedge = corners @ np.array([[c, s], [-s, c]]) + half
        colour = LIGHT_GREY if turns % 2 else "#eceff2"
        axes.fill([half, *wedge[:, 0]], [half, *wedge[:, 1]], color=colour, linewidth=0)
        label = 0.62 * (wedge.mean(axis=0) - half) + half
        axes.text(*label, name, ha="center", va="center", fontweight="bold")
    axes.plot(half, half, "o", color=FOREGROUND, markersize=4)


def _caption_faces(subject: StudySubject) -> FigureCaption:
    rim_deg = math.degrees(subject.camera.rim_rad)
    return FigureCaption(
        title="Five virtual cameras make a cube",
        caption=(
            "The views of the five virtual cameras at the effective viewpoint, 90° each: unfolded, "
            f"their borders fit without a gap. The mirror ends at {rim_deg:.0f}° of incidence and "
            "needs no sixth camera for the ceiling."
        ),
        alt=(
            "An unfolded cube of five images: left, forward, right and behind in a row with the "
            "horizon through their centres, the floor below the forward one."
        ),
        metrics={"field_of_view_deg": 90.0, "rim_deg": round(rim_deg, 3), "faces": 5},
    )


_SIZE_PX = 960
_MARGIN_PX = 100


def draw_omni_frame(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the frame with the 90-degree circle and the robot's sides."""
    subject = inputs.subject
    image = subject.render_frame(_SIZE_PX, samples=2)
    _label_robot_sides(page)
    axes = show_image(page, image, _MARGIN_PX, _MARGIN_PX - 30, _SIZE_PX)
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


def _draw_horizon(axes: Axes, centre_px: tuple[float, float], radius_px: float) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    u = centre_px[0] + radius_px * np.cos(angle)
    v = centre_px[1] + radius_px * np.sin(angle)
    axes.plot(u, v, color=RED, linewidth=0.7)
    # The label stands in the black corner outside the mirror, joined to the nearest point.
    label = math.radians(135.0)
    line = {"arrowstyle": "-", "color": RED, "linewidth": 0.7, "shrinkA": 1, "shrinkB": 0}
    axes.annotate(
        "90° circle\n(horizon)",
        xy=(centre_px[0] + radius_px * math.cos(label), centre_px[1] + radius_px * math.sin(label)),
        xytext=(0.015, 0.015),
        textcoords="axes fraction",
        color=BACKGROUND,
        arrowprops=line,
    )


def _label_robot_sides(page: Page) -> None:
    """Write the robot's sides around the image, forward with an arrow."""
    centre = _MARGIN_PX + 0.5 * _SIZE_PX
    height = _MARGIN_PX - 30 + 0.5 * _SIZE_PX
    centred = {"ha": "center", "va": "center"}
    bold = {"fontsize": 10.5, "fontweight": "bold"}
    add_text(page, centre, 36, "▲  forward", color=RED, **centred, **bold)
    add_text(page, centre, _SIZE_PX + 106, "behind", color=MUTED, **centred)
    # Exchanged: a mirror reverses the image, and the labels are the robot's own sides.
    for x, text, rotation in ((50, "robot's right", 90), (_SIZE_PX + 150, "robot's left", -90)):
        add_text(page, x, height, text, color=FOREGROUND, rotation=rotation, **centred, **bold)
