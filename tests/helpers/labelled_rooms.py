"""A room with things and robots, three kinds of cameras, an independent caster of their rays."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.mirror_checks import make_camera
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_test_world

WORLD = make_test_world()
SCENE = build_scene(WORLD)
ROBOTS = tuple(
    replace(robot, name=f"Robot{number}", number=number)
    for number, robot in enumerate(TWO_ROBOTS, 1)
)
STATE = replace(CAMERA_STATE, objects=ROBOTS)
SIDE_PX = 96
FISH_EYE = OmniCamera(
    EquidistantLens(),
    SIDE_PX,
    SIDE_PX,
    (0.5 * SIDE_PX, 0.5 * SIDE_PX),
    0.5 * SIDE_PX / math.radians(110.0),
    math.radians(110.0),
    picture=Picture.FLIPPED,
)
CAMERAS: dict[str, OmniCamera] = {
    "paper": make_omni_camera(width_px=SIDE_PX),
    "fish-eye": FISH_EYE,
    "ball": make_camera(SphericalMirror(0.03, 0.2, math.radians(120.0)), SIDE_PX),
}
# A barycentric weight within which a ray may honestly meet a triangle or its neighbour.
_EDGE = 1e-3


@contextmanager
def open_labels(engine: EngineName = "kernel", world: World = WORLD) -> Iterator[LabelRenderer]:
    """Label renderer of a world; skips the test where the kernel cannot run."""
    import pytest

    scene = SCENE if world is WORLD else build_scene(world)
    try:
        renderer = TraceRenderer(scene, world, threads=2, engine=engine)
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    labels = LabelRenderer(renderer, scene)
    try:
        yield labels
    finally:
        labels.close()
        renderer.close()


@dataclass(frozen=True, slots=True, eq=False)
class CastRays:
    """What an independent caster finds along the rays of all pixels' centres."""

    range_m: Floats
    """(h, w) metres; inf for nothing."""
    ids: npt.NDArray[np.int64]
    """(h, w) numbers of objects, by the order of the world file, robots last; 0 for nothing."""
    normal: Floats
    """(h, w, 3) unit, towards the origin, mirror frame."""
    point: Floats
    """(h, w, 3) world frame."""
    is_certain: Bools
    """(h, w) whether no edge is so near that float32 may meet its other side."""


def triangles_of(state: CameraState, scene: SceneMesh = SCENE) -> tuple[Floats, npt.NDArray[Any]]:
    """(n, 3, 3) corners of scene and robots in the world, and the number of each one's object."""
    corners, numbers = [scene.corners], [scene.object_index + 1]
    for number, placed in enumerate(state.objects, len(scene.objects) + 1):
        mesh = placed.mesh.corners.reshape(-1, 3)
        corners.append(placed.world_from_object.transform_points(mesh).reshape(-1, 3, 3))
        numbers.append(np.full(len(placed.mesh), number))
    return np.concatenate(corners), np.concatenate(numbers)


def cast_image(camera: OmniCamera, state: CameraState, pixels: Floats | None = None) -> CastRays:
    """Cast the rays of all pixels' centres, or of (h, w, 2) pixels, against every triangle."""
    if pixels is None:
        u, v = np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5
        pixels = np.stack(np.meshgrid(u, v), axis=-1)
    shape = pixels.shape[:2]
    origins, directions, valid = ray_from_pixel(camera, pixels.reshape(-1, 2))
    pose = state.world_from_mirror
    corners, numbers = triangles_of(state)
    origins, directions = pose.transform_points(origins), pose.rotate_directions(directions)
    to_planes = distance_to_planes(origins, directions, corners)
    margin = _smallest_weights(origins, directions, to_planes, corners)
    distance = np.where((margin >= 0.0) & (to_planes > 0.0), to_planes, np.inf)
    triangle = np.argmin(distance, axis=1)
    rows = np.arange(len(directions))
    range_m = np.where(valid, distance[rows, triangle], np.inf)
    hit = np.isfinite(range_m)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = (cross / np.linalg.norm(cross, axis=-1, keepdims=True))[triangle]
    facing = np.einsum("ni,ni->n", normal, directions) > 0.0
    normal = np.where(facing[:, None], -normal, normal) @ pose.rotation
    with np.errstate(invalid="ignore"):
        point = origins + range_m[:, None] * directions
    near = np.abs(margin) < _EDGE
    # An edge behind the hit changes nothing.
    is_before = to_planes < range_m[:, None] * 1.001
    certain = valid & ~(near & is_before).any(axis=1)
    return CastRays(
        range_m.reshape(shape),
        np.where(hit, numbers[triangle], 0).reshape(shape),
        np.where(hit[:, None], normal, 0.0).reshape(*shape, 3),
        np.where(hit[:, None], point, np.nan).reshape(*shape, 3),
        certain.reshape(shape),
    )


@np.errstate(divide="ignore", invalid="ignore")
def distance_to_planes(origins: Floats, directions: Floats, corners: Floats) -> Floats:
    """(n, m) distances along rays to the planes of triangles; nan for parallel ones."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    height = np.einsum("mi,mi->m", normal, corners[:, 0]) - origins @ normal.T
    return np.asarray(height / (directions @ normal.T))


@np.errstate(divide="ignore", invalid="ignore")
def _smallest_weights(
    origins: Floats, directions: Floats, distance: Floats, corners: Floats
) -> Floats:
    """(n, m) smallest barycentric weight of each plane's hit; negative outside the triangle."""
    margin = np.full(distance.shape, np.inf)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    squared = np.einsum("mi,mi->m", normal, normal)[:, None]
    for corner in range(3):
        begin, end = corners[:, (corner + 1) % 3], corners[:, (corner + 2) % 3]
        inward = np.cross(normal, end - begin) / squared
        # Products of matrices: points of all rays on all planes would be 200 MB.
        at_origin = origins @ inward.T - np.einsum("mi,mi->m", begin, inward)
        margin = np.minimum(margin, at_origin + distance * (directions @ inward.T))
    return margin
