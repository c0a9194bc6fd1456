"""The mirror as a thing with pictures on it, and the frame, both with the borders of the cube."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.cube_map import Face, face_coordinates, face_from_direction
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    half_angle_tangent,
    pixel_from_direction,
)
from catoptra_server.render.renderer import Image
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.axonometry import Axonometry
from catoptra_studies.camera_figures.figure_subject import FigureSubject

_VIEW_FROM_BELOW = Axonometry.from_view_angles(azimuth_deg=180.0, elevation_deg=-60.0)
_POINTS_PER_PIXEL = 3.0
# Directions in the middle of what the mirror shows of each face, for its letter.
_FACE_LABEL_DIRECTIONS = {
    Face.N: (1.0, 0.0, 0.1),
    Face.E: (0.0, 1.0, 0.1),
    Face.S: (-1.0, 0.0, 0.1),
    Face.W: (0.0, -1.0, 0.1),
    Face.C: (0.0, 0.0, 1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class _MirrorProjection:
    """Where points of the mirror come to lie, in pixels from the top left corner of its picture."""

    camera: OmniCamera
    pixels_per_metre: float

    def project(self, points: Floats) -> Floats:
        """Return (..., 2) pixels of (..., 3) points; the rim touches u = 0 and v = 0."""
        to_pixels = np.array([self.pixels_per_metre, -self.pixels_per_metre])
        rim = (
            _VIEW_FROM_BELOW.project(mirror_points(self.camera, _rim_directions(self.camera)))
            * to_pixels
        )
        placed: Floats = _VIEW_FROM_BELOW.project(points) * to_pixels - rim.min(axis=0)
        return placed


def draw_textured_mirror(
    page: plot_style.Page,
    camera: OmniCamera,
    face_images: dict[Face, Image],
    *,
    left: int,
    top: int,
    width: int,
) -> None:
    """Draw the mirror from behind and below with the cube's pictures on it."""
    drawing = _MirrorProjection(camera, 0.5 * width / _rim_radius_m(camera))
    points, direction = _visible_points(drawing)
    image = _average_colours(
        drawing.project(points).astype(int), sample_cube(face_images, direction)
    )
    over = plot_style.show_image(page, image, left, top, image.shape[1])
    for border in _cube_edges():
        seen = border[half_angle_tangent(border)[0] <= camera.rim_t]
        on_mirror = drawing.project(mirror_points(camera, seen))
        over.plot(*on_mirror.T, color=plot_style.BACKGROUND, linewidth=0.8)
    rim = drawing.project(mirror_points(camera, _rim_directions(camera)))
    over.plot(*rim.T, color=plot_style.MUTED, linewidth=0.8, clip_on=False)
    for face, letter_at in _FACE_LABEL_DIRECTIONS.items():
        _draw_face_label(over, drawing.project(mirror_points(camera, np.array(letter_at))), face)


def draw_frame_with_borders(
    page: plot_style.Page, subject: FigureSubject, *, left: int, top: int, width: int
) -> None:
    """Draw the frame with the borders of the cube's faces in it."""
    image = subject.render_frame(width, samples=3)
    camera = subject.resize_camera(image.shape[0])
    over = plot_style.show_image(page, image, left, top, width)
    for border in _cube_edges():
        pixel, seen = pixel_from_direction(camera, border)
        over.plot(*pixel[seen].T, color=plot_style.BACKGROUND, linewidth=0.8)
    for face, letter_at in _FACE_LABEL_DIRECTIONS.items():
        pixel, _ = pixel_from_direction(camera, np.array(letter_at))
        _draw_face_label(over, pixel, face)


def mirror_points(camera: OmniCamera, direction: Floats) -> Floats:
    """Return (..., 3) points of the mirror that (..., 3) directions from the viewpoint meet.

    Domain: directions within the rim.
    """
    t, _ = half_angle_tangent(direction)
    r, z = camera.mirror.surface_point(t)
    azimuth = np.arctan2(direction[..., 1], direction[..., 0])
    return np.stack((r * np.cos(azimuth), r * np.sin(azimuth), z), axis=-1)


def sample_cube(face_images: dict[Face, Image], direction: Floats) -> Floats:
    """Return (n, 3) colours in [0, 255] that the cube shows in (n, 3) directions."""
    face = face_from_direction(direction)
    place = face_coordinates(direction, face)
    colours = np.zeros((len(direction), 3))
    for which, image in face_images.items():
        of_face = face == which
        size = image.shape[0]
        texel = np.clip((0.5 * (place[of_face] + 1.0) * size).astype(int), 0, size - 1)
        colours[of_face] = image[texel[:, 1], texel[:, 0]]
    return colours


def _rim_radius_m(camera: OmniCamera) -> float:
    return float(camera.mirror.surface_point(np.array(camera.rim_t))[0])


def _visible_points(projection: _MirrorProjection) -> tuple[Floats, Floats]:
    """Return points and directions, each (n, 3), that cover what is seen of the mirror.

    A sunflower's spiral: as even as points can lie on a disc, so that no pixel is left out.
    """
    camera = projection.camera
    radius_px = projection.pixels_per_metre * _rim_radius_m(camera)
    count = math.ceil(_POINTS_PER_PIXEL * math.pi * radius_px**2)
    t = camera.rim_t * np.sqrt((np.arange(count) + 0.5) / count)
    azimuth = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    r, z = camera.mirror.surface_point(t)
    points = np.stack((r * cosine, r * sine, z), axis=-1)
    direction = points / np.linalg.norm(points, axis=-1, keepdims=True)
    # The normal halves the angle between the ways to viewpoint and pinhole.
    to_pinhole = np.array([0.0, 0.0, camera.mirror.pinhole_distance_m]) - points
    normal = direction + to_pinhole / np.linalg.norm(to_pinhole, axis=-1, keepdims=True)
    seen = normal @ _VIEW_FROM_BELOW.viewer_from_mirror[2] > 0.0
    return points[seen], direction[seen]


def _average_colours(pixels: npt.NDArray[np.intp], colours: Floats) -> Image:
    """Return the mean of the (n, 3) colours on each pixel of (n, 2) places; paper where is none.

    A pixel missed among points takes the mean of its neighbours.
    """
    width, height = pixels.max(axis=0) + 1
    shape = int(height), int(width)
    pixel = pixels[:, 1] * shape[1] + pixels[:, 0]
    weighted = np.concatenate((colours, np.ones((len(colours), 1))), axis=-1).T
    sums = np.stack([np.bincount(pixel, w, shape[0] * shape[1]).reshape(shape) for w in weighted])
    padded = np.pad(sums, ((0, 0), (1, 1), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    inside = (windows[3] > 0.0).sum(axis=(-1, -2)) > 4
    sums = np.where(sums[3] > 0.0, sums, np.where(inside, windows.sum(axis=(-1, -2)), 0.0))
    image = np.where(sums[3] > 0.0, sums[:3] / np.maximum(sums[3], 1.0), 255.0)
    return np.rint(np.moveaxis(image, 0, -1)).astype(np.uint8)


def _cube_edges() -> list[Floats]:
    """Return the eight edges between the five faces as (n, 3) directions."""
    along = np.linspace(-1.0, 1.0, 201)
    one = np.ones_like(along)
    level = [np.stack((along, side * one, one), axis=-1) for side in (-1.0, 1.0)]
    upright = [
        np.stack((x * one, y * one, along), axis=-1) for x in (-1.0, 1.0) for y in (-1.0, 1.0)
    ]
    return [*level, *(edge[:, (1, 0, 2)] for edge in level), *upright]


def _rim_directions(camera: OmniCamera) -> Floats:
    """Return (n, 3) directions just within the rim."""
    azimuth = np.linspace(0.0, 2.0 * math.pi, 361)
    theta = np.full_like(azimuth, camera.rim_rad)
    return np.stack(
        (np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)), axis=-1
    )


def _draw_face_label(axes: plot_style.Axes, pixel: Floats, face: Face) -> None:
    box = {"facecolor": plot_style.BACKGROUND, "edgecolor": "none", "pad": 2, "alpha": 0.85}
    axes.text(*pixel, face.name, ha="center", va="center", fontweight="bold", bbox=box)
