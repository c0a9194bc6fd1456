"""White targets on black, whose outlines measure how far each pixel of a frame is displaced.

A pixel that is lit off all targets, or dark on one, shows a point across an outline: it is
displaced at least by its distance from that outline. Hundreds of pixels beside outlines come near
the largest displacement of all, and none of them can overstate it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    face_coordinates,
    face_from_direction,
)
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy
from catoptra_server.render.renderer import Image
from catoptra_server.world.world_description import (
    Item,
    Material,
    Rectangle,
    Ring,
    Shape,
    World,
    linear_from_srgb,
)

_WHITE = Material((1.0, 1.0, 1.0), unlit=True)
# Places on an outline, and corners of a disc: they cut 9e-5 of its radius off.
_OUTLINE_POINTS = 240
# Of a side of a square: the rest is nearer to a corner than a texel, if a side has eight of them.
_SMOOTH_FRACTION = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementTargets:
    """Discs, or squares, each in a plane of its own, one unit ahead of the viewpoint."""

    axes: Floats
    """(n, 3, 3), columns ahead, right and down in the mirror frame."""
    centre: Floats
    """(n, 2) centre of each target in its plane."""
    half_size: Floats
    """(n,) radius or half a side."""
    is_round: bool
    """Discs, or else squares."""

    def build_world(self, world_from_mirror: Pose) -> World:
        """World of the targets."""
        items = tuple(
            Item(f"thing {i}", self._shape(i), world_from_mirror @ self._pose(i), _WHITE)
            for i in range(len(self.axes))
        )
        return World("things", items)

    def _shape(self, index: int) -> Shape:
        half = float(self.half_size[index])
        disc = Ring(0.0, half, sectors=_OUTLINE_POINTS)
        return disc if self.is_round else Rectangle((2.0 * half, 2.0 * half))

    def _pose(self, index: int) -> Pose:
        axes = self.axes[index]
        return Pose(np.roll(axes, -1, axis=1), axes @ (1.0, *self.centre[index]))

    def contains(self, directions: Floats) -> Bools:
        """(m,) whether each of (m, 3) directions hits a target."""
        ahead, right, down = (directions @ self.axes[:, :, axis].T for axis in range(3))
        aside = right - self.centre[:, 0] * ahead, down - self.centre[:, 1] * ahead
        far = np.hypot(*aside) if self.is_round else np.maximum(*np.abs(aside))
        return np.asarray((far < self.half_size * ahead).any(axis=-1))

    def outline_directions(self) -> tuple[Floats, Bools]:
        """(n * points, 3) directions of all outlines, and whether each is far from corners."""
        angle_rad = 2.0 * math.pi * np.arange(_OUTLINE_POINTS) / _OUTLINE_POINTS
        circle = np.stack((np.cos(angle_rad), np.sin(angle_rad)), axis=-1)
        smooth = np.ones(_OUTLINE_POINTS, dtype=np.bool_)
        if not self.is_round:
            circle /= np.abs(circle).max(axis=-1, keepdims=True)
            smooth = np.abs(circle).min(axis=-1) < _SMOOTH_FRACTION
        planes = self.centre[:, None] + self.half_size[:, None, None] * circle
        local = np.concatenate((np.ones((*planes.shape[:2], 1)), planes), axis=-1)
        directions: Floats = np.einsum("nij,npj->npi", self.axes, local)
        return directions.reshape(-1, 3), np.tile(smooth, len(self.axes))


def scatter_discs(
    camera: OmniCamera, *, size_px: float, count: int, rng: np.random.Generator
) -> DisplacementTargets:
    """Discs of about one size in the image that do not touch, anywhere within the rim.

    size_px: their diameter in the image along the more compressed direction.
    """
    directions, half = _scatter(camera, size_px=size_px, count=count, rng=rng)
    return DisplacementTargets(_plane_axes(directions), np.zeros((len(half), 2)), half, True)


def scatter_squares(
    camera: OmniCamera,
    *,
    size_px: float,
    count: int,
    rng: np.random.Generator,
    turn_rad: float = 0.0,
) -> DisplacementTargets:
    """Squares likewise, in the planes of the cube's faces, rotated from the texels."""
    directions, half = _scatter(camera, size_px=size_px, count=count, rng=rng)
    face = face_from_direction(directions)
    rotation = rotation_from_rpy(turn_rad, 0.0, 0.0)
    centre = face_coordinates(directions, face) @ rotation[1:, 1:]
    return DisplacementTargets(MIRROR_FROM_FACE_ROTATIONS[face] @ rotation, centre, half, False)


def _scatter(
    camera: OmniCamera, *, size_px: float, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """(n, 3) directions and (n,) half sizes at unit distance, evenly over the image."""
    radius_px = camera.rim_radius_px * np.sqrt(rng.uniform(0.0, 1.0, 60 * count))
    angle_rad = rng.uniform(-math.pi, math.pi, 60 * count)
    circle = np.stack((np.cos(angle_rad), np.sin(angle_rad)), axis=-1)
    points, _ = direction_from_pixel(camera, camera.centre_px + radius_px[:, None] * circle)
    t = camera.projection.t_from_radius_ratio(radius_px / camera.scale_px)
    along_px = camera.scale_px * camera.projection.radius_ratio_slope(t)
    across_px = radius_px * (1.0 + t * t) / (2.0 * t)
    half = 0.5 * size_px / np.minimum(along_px, across_px)
    # Half a square's diagonal, and a little room.
    reach = np.arctan(1.5 * half)
    chosen: list[int] = []
    for i in np.flatnonzero(2.0 * np.arctan(t) + reach < camera.rim_rad):
        min_cosine = np.cos(reach[i] + reach[chosen])
        if len(chosen) < count and (points[chosen] @ points[i] < min_cosine).all():
            chosen.append(int(i))
    return points[chosen], half[chosen]


def _plane_axes(directions: Floats) -> Floats:
    """(n, 3, 3) axes of planes perpendicular to (n, 3) unit directions."""
    aside = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    right = np.cross(aside, directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack((directions, right, np.cross(directions, right)), axis=-1)


def max_displacement_px(camera: OmniCamera, image: Image, targets: DisplacementTargets) -> float:
    """Displacement of the farthest wrong pixel of a frame with one sample a pixel.

    Pixels beside a corner do not count, since texels round corners off. Beside polygons a frame is
    black: a missing target is displaced to the rim at most.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, on_mirror = direction_from_pixel(camera, pixels)
    lit = linear_from_srgb(image[..., 0][on_mirror] / 255.0) > 0.5
    wrong = pixels[on_mirror][lit != targets.contains(directions[on_mirror])]
    outline, is_smooth = targets.outline_directions()
    outline_px, _ = pixel_from_direction(replace(camera, rim_rad=camera.rim_rad + 1e-3), outline)
    distance_px, nearest = _nearest(wrong, outline_px)
    to_rim_px = camera.rim_radius_px - np.linalg.norm(wrong - camera.centre_px, axis=1)
    displaced_px = np.minimum(distance_px, to_rim_px)[is_smooth[nearest]]
    return float(displaced_px.max(initial=0.0))


def _nearest(
    points: Floats, others: Floats
) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """(n,) distances of (n, 2) points to the nearest of (m, 2) others, and the indices of these.

    In single precision, good to 1e-4 px here and twice as fast.
    """
    distance, index = np.zeros(len(points)), np.zeros(len(points), dtype=np.intp)
    u, v = others.astype(np.float32).T
    for i, (point_u, point_v) in enumerate(points.astype(np.float32)):
        squared = np.square(u - point_u) + np.square(v - point_v)
        index[i] = squared.argmin()
        distance[i] = math.sqrt(squared[index[i]])
    return distance, index
