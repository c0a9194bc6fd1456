"""Drawings of the mirror in space: projection, shading, and the cube's images on the surface.

Parallel projection keeps a square face a parallelogram and lengths along an axis comparable;
polygons are drawn in painter's order. Points are (..., 3) in the mirror frame (z down); coordinates
of the drawing are right and up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.cube_map import Face, face_coordinates, face_from_direction
from catoptra_protocol.optics.numerics import Floats, half_angle_tangent
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_studies.plot_style import BACKGROUND, MUTED, Axes, Image, Page, label_box, show_image
from catoptra_studies.study_subject import StudySubject


@dataclass(frozen=True, slots=True, eq=False)
class Axonometry:
    """Parallel projection for a distant viewer."""

    viewer_from_mirror: Floats
    """(3, 3) rotation with the rows right, up, and towards the viewer."""

    @classmethod
    def from_view_angles(cls, *, azimuth_deg: float, elevation_deg: float) -> Axonometry:
        """The view from an azimuth (x towards y) and an elevation above the horizon."""
        azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
        level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        # z is down in the mirror frame.
        world_up = np.array([0.0, 0.0, -1.0])
        towards = math.cos(elevation) * level + math.sin(elevation) * world_up
        up = math.cos(elevation) * world_up - math.sin(elevation) * level
        return cls(np.stack((np.cross(up, towards), up, towards)))

    def project(self, points: Floats) -> Floats:
        """(..., 2) coordinates in the drawing of (..., 3) points."""
        return points @ self.viewer_from_mirror[:2].T

    def depth_order(self, polygons: Floats) -> npt.NDArray[np.intp]:
        """(n,) order from far to near of (n, k, 3) polygons."""
        # By centroids, which suffices for small polygons of one smooth surface.
        depth = polygons.mean(axis=1) @ self.viewer_from_mirror[2]
        return np.argsort(depth)

    def normals(self, polygons: Floats) -> Floats:
        """(n, 3) unit normals of (n, 4, 3) polygons in the viewer's frame.

        Normals of `mirror_polygons` leave the reflecting side.
        """
        # From the diagonals, which are never parallel, even where two corners coincide at the
        # vertex of the mirror.
        normal = np.cross(polygons[:, 3] - polygons[:, 1], polygons[:, 2] - polygons[:, 0])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal @ self.viewer_from_mirror.T


# Above the viewer's left shoulder, as in technical drawings.
_LIGHT_DIRECTION = np.array([-0.5, 0.15, 0.85])


def shade(normals: Floats) -> Floats:
    """(n,) brightness in [0, 1] of (n, 3) unit normals in the viewer's frame.

    A third of ambient light, Lambert's law, and a highlight after Blinn.
    """
    light = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
    cosine = np.clip(normals @ light, 0.0, None)
    half = light + np.array([0.0, 0.0, 1.0])
    highlight = np.clip(normals @ (half / np.linalg.norm(half)), 0.0, None) ** 30
    brightness: Floats = np.clip(0.35 + 0.5 * cosine + 0.15 * highlight, 0.0, 1.0)
    return brightness


_VIEW_FROM_BELOW = Axonometry.from_view_angles(azimuth_deg=180.0, elevation_deg=-60.0)
# With three points a pixel on average, few pixels are missed; `_average_colours` fills those.
_POINTS_PER_PIXEL = 3.0
# Directions of the letters, near the centre of each face's visible part.
_FACE_LABEL_DIRECTIONS = {
    Face.N: (1.0, 0.0, 0.1),
    Face.E: (0.0, 1.0, 0.1),
    Face.S: (-1.0, 0.0, 0.1),
    Face.W: (0.0, -1.0, 0.1),
    Face.C: (0.0, 0.0, 1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class _MirrorProjection:
    """Projection of the mirror's points to pixels of the drawing."""

    camera: OmniCamera
    pixels_per_metre: float

    def project(self, points: Floats) -> Floats:
        """(..., 2) pixels of (..., 3) points; the rim touches u = 0 and v = 0."""
        to_pixels = np.array([self.pixels_per_metre, -self.pixels_per_metre])
        rim = _VIEW_FROM_BELOW.project(rim_points(self.camera))
        corner = (rim * to_pixels).min(axis=0)
        pixels: Floats = _VIEW_FROM_BELOW.project(points) * to_pixels - corner
        return pixels


def draw_textured_mirror(
    page: Page,
    camera: OmniCamera,
    face_images: dict[Face, Image],
    *,
    left: int,
    top: int,
    width: int,
) -> None:
    """Draw the mirror from behind and below with the cube projected onto the surface.

    Args:
        page: Page to draw on.
        camera: Camera with the mirror to draw.
        face_images: Image of each face of the cube.
        left: Device pixels from the page's left edge.
        top: Device pixels from the page's upper edge.
        width: Device pixels of the mirror's diameter.
    """
    projection = _MirrorProjection(camera, 0.5 * width / rim_radius_m(camera))
    points, directions = _visible_points(projection)
    pixels = projection.project(points).astype(int)
    image = _average_colours(pixels, sample_cube(face_images, directions))
    axes = show_image(page, image, left, top, image.shape[1])
    for border in _cube_edges():
        on_mirror = border[half_angle_tangent(border)[0] <= camera.rim_t]
        line = projection.project(mirror_points(camera, on_mirror))
        axes.plot(*line.T, color=BACKGROUND, linewidth=0.8)
    rim = projection.project(rim_points(camera))
    axes.plot(*rim.T, color=MUTED, linewidth=0.8, clip_on=False)
    for face, direction in _FACE_LABEL_DIRECTIONS.items():
        label = projection.project(mirror_points(camera, np.array(direction)))
        _draw_face_label(axes, label, face)


def draw_frame_with_borders(
    page: Page, subject: StudySubject, *, left: int, top: int, width: int
) -> None:
    """Draw the frame with the borders of the cube's faces."""
    image = subject.render_frame(width, samples=3)
    camera = subject.resize_camera(image.shape[0])
    axes = show_image(page, image, left, top, width)
    for border in _cube_edges():
        pixels, is_visible = pixel_from_direction(camera, border)
        axes.plot(*pixels[is_visible].T, color=BACKGROUND, linewidth=0.8)
    for face, direction in _FACE_LABEL_DIRECTIONS.items():
        pixel, _ = pixel_from_direction(camera, np.array(direction))
        _draw_face_label(axes, pixel, face)


def mirror_points(camera: OmniCamera, directions: Floats) -> Floats:
    """(..., 3) intersections of the mirror with rays from the viewpoint.

    Args:
        camera: Camera with the mirror.
        directions: (..., 3) directions within the rim, in the mirror frame.
    """
    t, _ = half_angle_tangent(directions)
    # The profile is rotationally symmetric, so azimuth passes through unchanged.
    return _surface_points(camera, t, np.arctan2(directions[..., 1], directions[..., 0]))


def rim_points(camera: OmniCamera) -> Floats:
    """(n, 3) points along the mirror's rim, the first again at the end."""
    return _surface_points(camera, np.full(361, camera.rim_t), np.linspace(0.0, 2.0 * math.pi, 361))


def _surface_points(camera: OmniCamera, t: Floats, azimuth_rad: Floats) -> Floats:
    """(..., 3) points of the exact mirror at t = tan(theta/2)."""
    r, z = camera.mirror.surface_point(t)
    return np.stack((r * np.cos(azimuth_rad), r * np.sin(azimuth_rad), z), axis=-1)


def sample_cube(face_images: dict[Face, Image], directions: Floats) -> Floats:
    """(n, 3) colours in [0, 255] of the nearest texel in (n, 3) directions."""
    faces = face_from_direction(directions)
    coordinates = face_coordinates(directions, faces)
    colours = np.zeros((len(directions), 3))
    for face, image in face_images.items():
        is_on_face = faces == face
        size = image.shape[0]
        # Coordinates 1 on the border would give texel `size`, which belongs to the next face.
        texel = np.clip((0.5 * (coordinates[is_on_face] + 1.0) * size).astype(int), 0, size - 1)
        colours[is_on_face] = image[texel[:, 1], texel[:, 0]]
    return colours


def rim_radius_m(camera: OmniCamera) -> float:
    """Radius of the mirror."""
    return float(camera.mirror.surface_point(np.array(camera.rim_t))[0])


def _visible_points(projection: _MirrorProjection) -> tuple[Floats, Floats]:
    """Points of the mirror's visible side and their directions, each (n, 3).

    In a sunflower's spiral, which spreads any number of points evenly over a disc.
    """
    camera = projection.camera
    radius_px = projection.pixels_per_metre * rim_radius_m(camera)
    count = math.ceil(_POINTS_PER_PIXEL * math.pi * radius_px**2)
    t = camera.rim_t * np.sqrt((np.arange(count) + 0.5) / count)
    azimuth = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count, dtype=np.float64)
    points = _surface_points(camera, t, azimuth)
    directions = points / np.linalg.norm(points, axis=-1, keepdims=True)
    # The law of reflection: the normal bisects the angle between both ends of the ray.
    to_pinhole = np.array([0.0, 0.0, camera.mirror.pinhole_distance_m]) - points
    normals = directions + to_pinhole / np.linalg.norm(to_pinhole, axis=-1, keepdims=True)
    is_visible = normals @ _VIEW_FROM_BELOW.viewer_from_mirror[2] > 0.0
    return points[is_visible], directions[is_visible]


def _average_colours(pixels: npt.NDArray[np.intp], colours: Floats) -> Image:
    """Mean of the (n, 3) colours that fall on each pixel, white outside.

    A pixel missed between others takes the neighbours' mean.
    """
    width, height = pixels.max(axis=0) + 1
    shape = int(height), int(width)
    flat_index = pixels[:, 1] * shape[1] + pixels[:, 0]
    # A fourth channel of ones counts the points of each pixel.
    weighted = np.concatenate((colours, np.ones((len(colours), 1))), axis=-1).T
    sums = np.stack(
        [np.bincount(flat_index, w, shape[0] * shape[1]).reshape(shape) for w in weighted]
    )
    padded = np.pad(sums, ((0, 0), (1, 1), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    # More than four of eight neighbours: a gap. Fewer: the outside of the drawing's edge.
    is_inside = (windows[3] > 0.0).sum(axis=(-1, -2)) > 4
    sums = np.where(sums[3] > 0.0, sums, np.where(is_inside, windows.sum(axis=(-1, -2)), 0.0))
    image = np.where(sums[3] > 0.0, sums[:3] / np.maximum(sums[3], 1.0), 255.0)
    return np.rint(np.moveaxis(image, 0, -1)).astype(np.uint8)


def _cube_edges() -> list[Floats]:
    """The eight edges between the five faces, as (n, 3) directions each."""
    along = np.linspace(-1.0, 1.0, 201)
    one = np.ones_like(along)
    # Four edges around the lower face C, then the four upright ones.
    level = [np.stack((along, side * one, one), axis=-1) for side in (-1.0, 1.0)]
    upright = [
        np.stack((x * one, y * one, along), axis=-1) for x in (-1.0, 1.0) for y in (-1.0, 1.0)
    ]
    return [*level, *(edge[:, (1, 0, 2)] for edge in level), *upright]


def _draw_face_label(axes: Axes, pixel: Floats, face: Face) -> None:
    box = label_box(2, alpha=0.85)
    axes.text(*pixel, face.name, ha="center", va="center", fontweight="bold", bbox=box)
