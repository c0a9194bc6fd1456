"""Synthetic frames with known ground truth, ray cast in numpy, for the detector's tests.

Independent of `catoptra_client.landmarks.training`: rays are intersected with cylinders,
discs, boards and the floor, shaded, 2 x 2 per pixel, averaged in linear light, encoded as sRGB,
with the noise of a camera. World frame: z down, floor at z = 0.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np

from catoptra_protocol.landmarks import Landmark, read_landmarks
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    direction_from_pixel,
)

FIELD_LANDMARKS = read_landmarks(
    Path(__file__).parents[3] / "configs/landmarks/four_legged_2006.csv"
)
VIEWPOINT_HEIGHT_M = 0.6
SAMPLES_PER_AXIS = 2
NOISE_LEVELS = 1.4  # of a CCD at mid-grey

ALBEDO = {
    "cyan": (0.05, 0.55, 0.70),
    "magenta": (0.70, 0.06, 0.35),
    "yellow": (0.80, 0.65, 0.04),
    "white": (0.80, 0.80, 0.80),
    "carpet": (0.04, 0.25, 0.07),
    "floor": (0.30, 0.28, 0.25),
    "wall": (0.45, 0.45, 0.47),
    "ceiling": (0.60, 0.60, 0.60),
}
LIGHT_DIRECTION = np.array([0.4, 0.3, -0.866])  # towards the light
AMBIENT_LIGHT, DIRECT_LIGHT = 0.55, 0.5


@functools.cache
def make_camera() -> OmniCamera:
    """Paper's camera: 360 x 360 px, rim at 120 degrees."""
    mirror = PAPER_MIRROR
    return camera_with_inscribed_rim(
        mirror, width_px=360, height_px=360, rim_rad=math.radians(120.0)
    )


@functools.cache
def _sample_directions() -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) directions of all samples on the mirror, and their flat pixel index."""
    pixel = pixel_sample_positions(make_camera(), SAMPLES_PER_AXIS)
    direction, seen = direction_from_pixel(make_camera(), pixel)
    height, width = direction.shape[:2]
    index = np.broadcast_to(np.arange(height * width).reshape(height, width, 1), seen.shape)
    return direction[seen], index[seen]


class NearestHits:
    """Nearest hits of a bundle of rays so far: distance (n,) and colour (n, 3)."""

    def __init__(self, origin: np.ndarray, rays: np.ndarray) -> None:
        self.origin, self.rays = origin, rays
        self.distance = np.full(len(rays), np.inf)
        self.colour = np.full((len(rays), 3), ALBEDO["ceiling"])
        self.azimuth = np.arctan2(rays[:, 1], rays[:, 0])

    def find_rays_towards(self, x: float, y: float, radius: float) -> np.ndarray:
        """Indices of the rays that may meet a disc's upright cylinder."""
        dx, dy = x - self.origin[0], y - self.origin[1]
        reach = math.hypot(dx, dy)
        if reach <= 1.05 * radius:
            return np.arange(len(self.rays))
        off = np.abs(np.angle(np.exp(1j * (self.azimuth - math.atan2(dy, dx)))))
        return np.flatnonzero(off <= 1.01 * math.asin(radius / reach))

    def add_surface(self, index, distance, hit, albedo, normal) -> None:
        """Colour the rays that this surface blocks first so far; albedo, normal (m, 3) or (3,)."""
        nearer = hit & (distance > 1e-9) & (distance < self.distance[index])
        light = AMBIENT_LIGHT + DIRECT_LIGHT * np.maximum(np.asarray(normal) @ LIGHT_DIRECTION, 0.0)
        shaded = np.broadcast_to(np.asarray(albedo) * light[..., None], (len(index), 3))
        self.distance[index[nearer]] = distance[nearer]
        self.colour[index[nearer]] = shaded[nearer]


def draw_floor(hits: NearestHits, *, field: bool) -> None:
    down = hits.rays[:, 2] > 1e-6
    index = np.flatnonzero(down)
    distance = -hits.origin[2] / hits.rays[index, 2]
    points = hits.origin[:2] + distance[:, None] * hits.rays[index, :2]
    x, y = np.abs(points[:, 0]), np.abs(points[:, 1])
    albedo = np.full((len(index), 3), ALBEDO["floor"])
    if field:
        albedo[(x <= 3.0) & (y <= 2.0)] = ALBEDO["carpet"]
        edge = (np.abs(np.maximum(x / 2.7, y / 1.8) - 1.0) * 1.8 < 0.0125) & (x < 2.72) & (y < 1.82)
        ring = np.abs(np.hypot(x, y) - 0.18) < 0.0125
        albedo[edge | ring | ((x < 0.0125) & (y < 1.8))] = ALBEDO["white"]
    hits.add_surface(index, distance, np.ones(len(index), bool), albedo, np.array([0, 0, -1.0]))


def draw_board(
    hits: NearestHits, axis: int, position_m: float, span, height: float, albedo
) -> None:
    """Draw an upright board at `at` on one level axis, over a span of the other."""
    along = hits.rays[:, axis]
    index = np.flatnonzero(np.abs(along) > 1e-9)
    distance = (position_m - hits.origin[axis]) / along[index]
    points = hits.origin + distance[:, None] * hits.rays[index]
    across, up = points[:, 1 - axis], -points[:, 2]
    hit = (across >= span[0]) & (across <= span[1]) & (up >= 0.0) & (up <= height)
    normal = np.zeros((len(index), 3))
    normal[:, axis] = -np.sign(along[index])
    hits.add_surface(index, distance, hit, albedo, normal)


def draw_beacon(hits: NearestHits, landmark: Landmark) -> None:
    radius = 0.5 * landmark.width_m
    index = hits.find_rays_towards(landmark.x_m, landmark.y_m, radius)
    rays, relative = hits.rays[index], hits.origin[:2] - np.array([landmark.x_m, landmark.y_m])
    a = (rays[:, :2] ** 2).sum(axis=1)
    half_b = rays[:, :2] @ relative
    inside = half_b**2 - a * (relative @ relative - radius**2)
    distance = (-half_b - np.sqrt(np.maximum(inside, 0.0))) / np.maximum(a, 1e-12)
    points = hits.origin + distance[:, None] * rays
    up = -points[:, 2]
    albedo = np.array([ALBEDO[landmark.upper_colour]]).repeat(len(index), axis=0)
    albedo[up < landmark.band_centre_m] = ALBEDO[landmark.lower_colour]
    albedo[up < landmark.band_bottom_m] = ALBEDO["white"]
    normal = np.zeros((len(index), 3))
    normal[:, :2] = (points[:, :2] - np.array([landmark.x_m, landmark.y_m])) / radius
    hit = (inside >= 0.0) & (up >= 0.0) & (up <= landmark.band_top_m)
    hits.add_surface(index, distance, hit, albedo, normal)
    _draw_cap(hits, landmark, index)


def _draw_cap(hits: NearestHits, landmark: Landmark, index: np.ndarray) -> None:
    down = hits.rays[index, 2]
    distance = (-landmark.band_top_m - hits.origin[2]) / np.where(down == 0.0, 1e-12, down)
    points = hits.origin[:2] + distance[:, None] * hits.rays[index, :2]
    hit = (
        np.hypot(points[:, 0] - landmark.x_m, points[:, 1] - landmark.y_m) <= 0.5 * landmark.width_m
    )
    hits.add_surface(index, distance, hit, ALBEDO[landmark.upper_colour], np.array([0, 0, -1.0]))


def draw_goal(hits: NearestHits, landmark: Landmark) -> None:
    half = 0.5 * landmark.width_m
    outward = math.copysign(1.0, landmark.x_m)
    back = landmark.x_m + outward * landmark.depth_m
    depth = sorted((landmark.x_m, back))
    albedo = ALBEDO[landmark.lower_colour]
    draw_board(
        hits, 0, back, (landmark.y_m - half, landmark.y_m + half), landmark.band_top_m, albedo
    )
    for y in (landmark.y_m - half, landmark.y_m + half):
        draw_board(hits, 1, y, depth, landmark.band_top_m, albedo)


def draw_walls(hits: NearestHits) -> None:
    for side in (-1.0, 1.0):
        draw_board(hits, 0, 4.0 * side, (-3.0, 3.0), 1.2, ALBEDO["wall"])
        draw_board(hits, 1, 3.0 * side, (-4.0, 4.0), 1.2, ALBEDO["wall"])


def render_frame(
    landmarks, pose=(0.0, 0.0, 0.0), *, seed: int = 0, height_m: float = VIEWPOINT_HEIGHT_M
):
    """(360, 360, 3) uint8 frame of a robot at pose x, y, yaw among landmarks."""
    direction, index = _sample_directions()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    scene = NearestHits(np.array([pose[0], pose[1], -height_m]), direction @ turn.T)
    draw_floor(scene, field=True)
    draw_walls(scene)
    for row in landmarks:
        {"beacon": draw_beacon, "goal": draw_goal}[row.kind](scene, row)
    return _encode_frame(scene.colour, index, seed)


def _encode_frame(colour: np.ndarray, index: np.ndarray, seed: int) -> np.ndarray:
    pixels = make_camera().width_px * make_camera().height_px
    linear = np.stack(
        [np.bincount(index, colour[:, i], minlength=pixels) for i in range(3)], axis=-1
    )
    linear = np.clip(linear / SAMPLES_PER_AXIS**2, 0.0, 1.0)
    encoded = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
    noise = NOISE_LEVELS * np.random.default_rng(seed).normal(size=encoded.shape)
    levels = np.clip(np.round(255.0 * encoded + noise), 0, 255).astype(np.uint8)
    return levels.reshape(make_camera().height_px, make_camera().width_px, 3)
