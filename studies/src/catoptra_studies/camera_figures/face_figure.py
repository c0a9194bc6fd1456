"""The five virtual cameras' views, unfolded: the paper's Figure 5.

Four sides in a row, so that the panorama runs on over their borders, and the view down under the
one that looks forward. The part that the mirror never looks into is veiled.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Bools
from catoptra_server.render.renderer import Image
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption
from catoptra_studies.camera_figures.figure_subject import FigureSubject

FACES = (Face.W, Face.N, Face.E, Face.S, Face.C)
FACE_TITLES = {
    Face.N: "N  forward",
    Face.E: "E  right",
    Face.S: "S  behind",
    Face.W: "W  left",
    Face.C: "C  down",
}
_FACE_SIZE_PX = 370
_LEFT_PX = 20
_TOP_PX = 20


def draw(page: plot_style.Page, subject: FigureSubject) -> FigureCaption:
    """Draw the unfolded cube and, beside it, where its cameras look."""
    for face in FACES:
        image = subject.render_face(face, _FACE_SIZE_PX, samples=3)
        image = dim_hidden_pixels(
            image, _visible_mask(face, image.shape[0], subject.camera.rim_rad)
        )
        column = 1 if face == Face.C else FACES.index(face)
        top = _TOP_PX + (_FACE_SIZE_PX if face == Face.C else 0)
        over = plot_style.show_image(
            page, image, _LEFT_PX + column * _FACE_SIZE_PX, top, _FACE_SIZE_PX
        )
        _outline_face(over, face, image.shape[0])
    _draw_explanation(page, math.degrees(subject.camera.rim_rad))
    return _caption(subject)


def dim_hidden_pixels(image: Image, mask: Bools) -> Image:
    """Return the image with everything that is not seen blended towards a cool grey."""
    veil = (0.4 * image + 0.6 * np.array([70.0, 84.0, 98.0])).astype(np.uint8)
    return np.where(mask[..., None], image, veil)


def _visible_mask(face: Face, size_px: int, rim_rad: float) -> Bools:
    """Return which (size, size) pixels of a face lie within the mirror's rim."""
    steps = 2.0 * (np.arange(size_px) + 0.5) / size_px - 1.0
    t, s = np.meshgrid(steps, steps, indexing="ij")
    direction = np.stack((np.ones_like(s), s, t), axis=-1) @ MIRROR_FROM_FACE_ROTATIONS[face].T
    cosine = direction[..., 2] / np.linalg.norm(direction, axis=-1)
    seen: Bools = cosine >= math.cos(rim_rad)
    return seen


def _outline_face(axes: plot_style.Axes, face: Face, size_px: int) -> None:
    """Frame and name a face; draw the horizon on the sides."""
    edge = [0, size_px, size_px, 0, 0]
    axes.plot(
        edge, [0, 0, size_px, size_px, 0], color=plot_style.FOREGROUND, linewidth=0.8, clip_on=False
    )
    if face != Face.C:
        axes.plot([0, size_px], [0.5 * size_px] * 2, color=plot_style.RED, linewidth=0.7)
    box = {"facecolor": plot_style.BACKGROUND, "edgecolor": "none", "pad": 2.5}
    axes.text(
        0.035 * size_px, 0.035 * size_px, FACE_TITLES[face], va="top", fontweight="bold", bbox=box
    )


def _draw_explanation(page: plot_style.Page, rim_deg: float) -> None:
    left, top = _LEFT_PX + 2 * _FACE_SIZE_PX, _TOP_PX + _FACE_SIZE_PX
    _draw_camera_layout(
        plot_style.add_pixel_axes(page, left + 20, top + 20, _FACE_SIZE_PX - 40, _FACE_SIZE_PX - 40)
    )
    x = left + _FACE_SIZE_PX
    plot_style.add_text(
        page, x, top + 80, "from above: four level cameras\nof 90°; the fifth looks down"
    )
    plot_style.add_text(page, x, top + 180, "horizon, θ = 90°", color=plot_style.RED)
    veil = f"veiled: above θ = {rim_deg:.0f}°,\nbeyond the mirror's rim"
    plot_style.add_text(page, x, top + 240, veil, color=plot_style.MUTED)


def _draw_camera_layout(axes: plot_style.Axes) -> None:
    """Draw the four level cameras' fields of view around the viewpoint, forward up."""
    half = 0.5 * axes.get_xlim()[1]
    reach = 0.92 * half
    corners = np.array([[-1.0, -1.0], [1.0, -1.0]]) * reach
    for turns, name in enumerate("NESW"):
        c, s = round(math.cos(turns * math.pi / 2)), round(math.sin(turns * math.pi / 2))
        wedge = corners @ np.array([[c, s], [-s, c]]) + half
        shade = plot_style.LIGHT_GREY if turns % 2 else "#eceff2"
        axes.fill([half, *wedge[:, 0]], [half, *wedge[:, 1]], color=shade, linewidth=0)
        middle = 0.62 * (wedge.mean(axis=0) - half) + half
        axes.text(*middle, name, ha="center", va="center", fontweight="bold")
    axes.plot(half, half, "o", color=plot_style.FOREGROUND, markersize=4)


def _caption(subject: FigureSubject) -> FigureCaption:
    rim_deg = math.degrees(subject.camera.rim_rad)
    return FigureCaption(
        title="Five virtual cameras make a cube",
        caption=(
            "What the five virtual cameras at the effective viewpoint see, 90° each: unfolded, "
            f"their borders fit without a gap. The mirror ends at {rim_deg:.0f}° of incidence and "
            "needs no sixth camera for the ceiling."
        ),
        alt=(
            "An unfolded cube of five pictures: left, forward, right and behind in a row with the "
            "horizon through their middles, the floor below the forward one."
        ),
        metrics={"field_of_view_deg": 90.0, "rim_deg": round(rim_deg, 3), "faces": 5},
    )
