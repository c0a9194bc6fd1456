"""An omnidirectional camera with a finite aperture, ray by ray: the reference for lens effects.

Each ray leaves the thin lens at a point of its aperture towards the point in focus for the pixel,
is reflected at the mirror's surface, and continues into the scene. Written from the surfaces'
equations, as quadrics alpha r^2 + beta z^2 + gamma z + delta = 0 in the mirror frame; only the
image's scale comes from the camera model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.render.trace.reference.meshes import (
    PlacedMesh,
    WorldRays,
    find_first_hits,
    interpolate_poses,
    trace_scene,
)
from catoptra_server.render.trace.reference.pixels import Lighting, shade_hits
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World

SAMPLES = 256


@dataclass(frozen=True)
class Quadric:
    """alpha r^2 + beta z^2 + gamma z + delta = 0, on the side of z < `max_z_m`."""

    alpha: float
    beta: float
    gamma: float
    delta: float
    max_z_m: float

    @classmethod
    def from_mirror(cls, mirror: object) -> Quadric:
        """A mirror's surface, from its equation."""
        if isinstance(mirror, HyperbolicMirror):
            k, c = mirror.k, mirror.c_m
            return cls(1.0 - 0.5 * k, 1.0, -c, c * c / (2.0 * k), 0.5 * c)
        assert isinstance(mirror, ParabolicMirror)
        p = mirror.horizon_radius_m
        return cls(1.0, 0.0, 2.0 * p, -p * p, math.inf)

    def intersect(self, origin: Floats, direction: Floats) -> Floats:
        """(n, 3) first points of rays on that side; NaN for none."""
        flat_o, flat_d = origin[:, :2], direction[:, :2]
        o, d = origin[:, 2], direction[:, 2]
        a = self.alpha * (flat_d**2).sum(axis=1) + self.beta * d * d
        half_b = self.alpha * (flat_o * flat_d).sum(axis=1) + d * (self.beta * o + 0.5 * self.gamma)
        c = self.alpha * (flat_o**2).sum(axis=1) + o * (self.beta * o + self.gamma) + self.delta
        with np.errstate(all="ignore"):
            root = np.sqrt(half_b * half_b - a * c)
            q = -half_b - np.copysign(root, half_b)
            roots = np.stack((q / a, c / q))
            heights = o + roots * d
            roots[~((roots > 0.0) & (heights < self.max_z_m))] = np.inf
            distance = roots.min(axis=0)
            points: Floats = (
                origin + np.where(np.isfinite(distance), distance, np.nan)[:, None] * direction
            )
        return points

    def normal(self, point: Floats) -> Floats:
        """(n, 3) unit normals."""
        gradient = np.column_stack(
            (self.alpha * point[:, :2], self.beta * point[:, 2] + 0.5 * self.gamma)
        )
        unit: Floats = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        return unit


class LensRays(Protocol):
    """A lens: rays of pixels through a point of its aperture."""

    def __call__(self, offset_px: Floats, aperture_point: Floats) -> tuple[Floats, Floats]:
        """(n, 3) origins and directions; (n, 2) px from the axis, aperture point in a unit disc."""


def focus_lens(camera: OmniCamera, aperture: Aperture) -> LensRays:
    """A thin lens around the pinhole whose image distance is the image's scale."""
    focal_px, sharp_at = 1.0 / camera.inverse_focal_length, aperture.focus_coordinate(camera)
    focal_m = 1.0 / (1.0 / (focal_px * aperture.pixel_pitch_m) + sharp_at)
    aperture_m, focus_m = focal_m / aperture.f_number, 1.0 / sharp_at
    pinhole = np.array((0.0, 0.0, camera.mirror.pinhole_distance_m))

    def rays(offset_px: Floats, aperture_point: Floats) -> tuple[Floats, Floats]:
        depth = np.full(len(offset_px), -1.0)
        sharp = pinhole + focus_m * np.column_stack((offset_px / focal_px, depth))
        start = pinhole + 0.5 * aperture_m * np.append(aperture_point, 0.0)
        return np.broadcast_to(start, sharp.shape), sharp - start

    return rays


def telecentric_lens(px_per_m: float, *, slope: float, focus_height_m: float) -> LensRays:
    """An orthographic lens in focus at a height; slope: half the width of its cones."""

    def rays(offset_px: Floats, aperture_point: Floats) -> tuple[Floats, Floats]:
        height = np.full(len(offset_px), focus_height_m)
        sharp = np.column_stack((offset_px / px_per_m, height))
        direction = np.append(slope * aperture_point, -1.0)
        return sharp - direction, np.broadcast_to(direction, sharp.shape)

    return rays


def render_through_lens(
    lens: LensRays,
    camera: OmniCamera,
    world: World,
    pose: Pose,
    *,
    stride_px: int = 1,
    max_radiance: float = 1.25,
) -> Floats:
    """(rows, columns, 3) linear light of pixels: means over pixel and aperture.

    Only every n-th pixel in both directions. Black where a ray misses the mirror within the rim.
    """
    scene = build_scene(world)
    centre = scene.centre
    mesh = trace_scene(scene, centre, world.lights)
    meshes = (PlacedMesh(mesh, interpolate_poses((Pose.identity(),), None)),)
    lighting = Lighting(centre, world.background, has_shadows=False)
    quadric = Quadric.from_mirror(camera.mirror)
    rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])

    def sample(sample_point: tuple[Floats, Floats]) -> Floats:
        offset, aperture_point = sample_point
        origin, direction = lens(_offset_from_axis_px(camera, offset, stride_px), aperture_point)
        hits = quadric.intersect(origin, direction)
        on_mirror: Bools = np.hypot(hits[:, 0], hits[:, 1]) <= rim_m
        hits, direction = hits[on_mirror], direction[on_mirror]
        normal = quadric.normal(hits)
        away = direction - 2.0 * (direction * normal).sum(axis=1, keepdims=True) * normal
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        # Steps of zero: the rays of an aperture are finer than any texel.
        rays = WorldRays(
            pose.transform_points(hits) - centre,
            pose.rotate_directions(away),
            np.zeros((len(hits), 2, 3)),
        )
        radiance = shade_hits(meshes, rays, find_first_hits(meshes, rays), lighting)
        light = np.zeros((len(on_mirror), 3))
        light[on_mirror] = np.clip(radiance, 0.0, max_radiance)
        return light

    with ThreadPoolExecutor(2) as pool:
        total = sum(pool.map(sample, _quasirandom_samples()), start=np.zeros(3))
    return (total / SAMPLES).reshape(-(-camera.height_px // stride_px), -1, 3)


def _offset_from_axis_px(camera: OmniCamera, offset: Floats, stride_px: int) -> Floats:
    """(n, 2) px from the axis, along x and y of the mirror frame, of positions in pixels."""
    du = np.arange(0, camera.width_px, stride_px) + offset[0] - camera.centre_px[0]
    dv = np.arange(0, camera.height_px, stride_px) + offset[1] - camera.centre_px[1]
    du, dv = (flat.reshape(-1) for flat in np.meshgrid(du, dv))
    ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    return np.column_stack((sa * du - ca * dv, -ca * du - sa * dv))


def _quasirandom_samples() -> Iterator[tuple[Floats, Floats]]:
    """Yield points in the pixel and in the unit disc, evenly in all four dimensions.

    Additive recurrence by the root of x^5 = x + 1, Roberts 2018.
    """
    root = 1.1673039782614187
    step = root ** -np.arange(1.0, 5.0)
    for index in range(SAMPLES):
        at = (0.5 + (index + 1) * step) % 1.0
        radius, angle = math.sqrt(at[2]), 2.0 * math.pi * at[3]
        yield at[:2], radius * np.array((math.cos(angle), math.sin(angle)))
