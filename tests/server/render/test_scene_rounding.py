"""The bound of a frame in worlds of up to 200 km, with things up to 2 cm near: never exceeded.

Displacements are angles at the viewpoint, exact for each pixel: beside a disc from its outline,
beside a rectangle from the planes of its edges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    add_scene,
    angle_error,
    coordinate_errors,
    error_bound,
)
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Renderer, RenderPlan, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState, DynamicObject, OrientedBox, box_distances
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, Ring, World
from helpers.displacement_targets import scatter_discs
from helpers.dynamic_objects import build_cube_mesh
from helpers.long_cases import quick_cases
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=400)
WHITE = Material((1.0, 1.0, 1.0), unlit=True)
BLACK = Material((0.0, 0.0, 0.0), unlit=True)
DISC_PX = 14.0

MakeRenderer = Callable[[World, RendererKind], Renderer]


@pytest.fixture
def make_renderer(device: GlDevice) -> Iterator[MakeRenderer]:
    traced: list[TraceRenderer] = []

    def make(world: World, kind: RendererKind) -> Renderer:
        scene = build_scene(world)
        if kind is RendererKind.RASTER:
            return RasterRenderer(scene, world, device=device)
        traced.append(TraceRenderer(scene, world, threads=1))
        return traced[-1]

    yield make
    for renderer in traced:
        renderer.close()


def make_plan(kind: RendererKind) -> RenderPlan:
    return plan_from_settings(RenderSettings(samples=1), CAMERA, kind=kind, reason="test")


def lit_pixels(renderer: Renderer, kind: RendererKind, state: CameraState) -> tuple[Bools, Floats]:
    """(n,) whether the pixels on the mirror are white, and their (n, 3) world directions."""
    view = renderer.prepare(CAMERA, make_plan(kind))
    image = view.render(state).rgb
    view.close()
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[:, :, 0])
    lit = image.reshape(-1, 3)[on_mirror.ravel(), 0] > 127
    return lit, directions[on_mirror] @ state.world_from_mirror.rotation.T


def frame_bound_rad(world: World, kind: RendererKind, state: CameraState) -> float:
    """Bound of a frame, as the server states it."""
    return math.radians(bound_frame(world, kind, state).geometric.max_deg)


def bound_frame(world: World, kind: RendererKind, state: CameraState) -> ErrorBound:
    scene = build_scene(world)
    errors = coordinate_errors(CAMERA, kind, is_large=scene.is_large)
    angle_rad = SceneSummarizer(scene, world).max_rounding_angle_rad(state, errors)
    return add_scene(error_bound(CAMERA, make_plan(kind)), angle_error(CAMERA, angle_rad))


def make_state(seed: int) -> CameraState:
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-3.0, 3.0, 3) * (0.02, 0.02, 1.0)
    return CameraState(Pose.from_rpy(rng.uniform(-1.0, 1.0, 3), turn))


def place_discs(
    state: CameraState, distance_m: float, seed: int
) -> tuple[list[Item], Floats, Floats]:
    """Discs that face the viewpoint, their (n, 3) world directions and (n,) angular radii."""
    rng = np.random.default_rng(seed)
    targets = scatter_discs(CAMERA, size_px=DISC_PX, count=25, rng=rng)
    axes = state.world_from_mirror.rotation @ targets.axes
    items = [
        Item(
            f"disc {index}",
            Ring(0.0, float(half) * distance_m, sectors=720),
            Pose(
                np.roll(axes[index], -1, axis=1),
                state.world_from_mirror.translation + distance_m * axes[index, :, 0],
            ),
            WHITE,
        )
        for index, half in enumerate(targets.half_size)
    ]
    return items, axes[:, :, 0], np.arctan(targets.half_size)


@pytest.mark.parametrize(
    ("kind", "distance_m", "extent_m", "place"),
    # Of 36 cases every fifth: each value of each parameter, with others each time.
    quick_cases(
        product(RendererKind, (0.02, 0.06, 0.3), (2e3, 2e4, 2e5), (0.0, 0.9)), *range(0, 36, 5)
    ),
    ids=str,
)
def test_thing_nearby_in_a_large_world_is_displaced_within_the_bound(
    make_renderer: MakeRenderer,
    kind: RendererKind,
    distance_m: float,
    extent_m: float,
    place: float,
) -> None:
    state = make_state(seed=int(extent_m) + int(1000 * distance_m))
    discs, axes, radius_rad = place_discs(state, distance_m, seed=1)
    offset = np.array((0.5 * place * extent_m, 0.35 * place * extent_m, 0.5))
    centre = state.world_from_mirror.translation + offset
    floor = Item("floor", Rectangle((extent_m, extent_m)), Pose(np.eye(3), centre), BLACK)
    world = World("large", (*discs, floor))
    lit, directions = lit_pixels(make_renderer(world, kind), kind, state)
    angles_rad = np.arccos(np.clip(directions @ axes.T, -1.0, 1.0))
    beside_rad = angles_rad - radius_rad
    wrong = lit != (beside_rad < 0.0).any(axis=1)
    displaced_rad = np.abs(beside_rad[wrong]).min(axis=1)
    # Two polygons of 720 sides lie within 1e-5 of a disc's radius.
    reserve_rad = 1e-5 * float(radius_rad.max())
    assert lit.any()
    assert displaced_rad.max(initial=0.0) <= frame_bound_rad(world, kind, state) + reserve_rad


def random_rotation(rng: np.random.Generator) -> Floats:
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation[:, 2] *= np.sign(np.linalg.det(rotation))
    return np.asarray(rotation)


@pytest.mark.parametrize("kind", list(RendererKind), ids=lambda kind: kind.value)
@pytest.mark.parametrize(
    ("side_m", "distance_m"), [(2e2, 0.02), (2e3, 0.3), (2e4, 0.3), (2e5, 0.3), (2e4, 5.0)]
)
def test_edge_of_a_large_rectangle_nearby_is_displaced_within_the_bound(
    make_renderer: MakeRenderer, kind: RendererKind, side_m: float, distance_m: float
) -> None:
    seen = 0
    for seed in range(6):
        rng, half_m = np.random.default_rng(seed), 0.5 * side_m
        rotation, state = random_rotation(rng), make_state(seed)
        # One edge passes by the foot of the perpendicular from the viewpoint.
        centre = (
            (half_m + distance_m * rng.uniform(-1.0, 1.0)) * rotation[:, 0]
            + half_m * rng.uniform(-0.3, 0.3) * rotation[:, 1]
            - distance_m * rotation[:, 2]
        )
        pose = Pose(rotation, state.world_from_mirror.translation + centre)
        world = World("edge", (Item("edge", Rectangle((side_m, side_m)), pose, WHITE),))
        lit, directions = lit_pixels(make_renderer(world, kind), kind, state)
        along = (centre @ rotation[:, 2]) / (directions @ rotation[:, 2])
        on_plane = along[:, None] * directions - centre
        is_inside = (along > 0.0) & (np.abs(on_plane @ rotation[:, :2]) <= half_m).all(axis=1)
        wrong = lit != is_inside
        planes = edge_planes(centre, half_m * rotation[:, :2])
        displaced_rad = np.arcsin(np.abs(directions[wrong] @ planes.T).min(axis=1))
        assert displaced_rad.max(initial=0.0) <= frame_bound_rad(world, kind, state)
        seen += int(is_inside.any() and not is_inside.all())
    assert seen >= 4, "the edges are in view"


def edge_planes(centre: Floats, half: Floats) -> Floats:
    """(4, 3) unit normals of the planes through the origin and a rectangle's edges."""
    signs = np.array(((1, 1), (1, -1), (-1, -1), (-1, 1)))
    corners = centre + signs @ half.T
    normals = np.cross(corners, np.roll(corners, -1, axis=0))
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def edge_points(box: OrientedBox, *, count: int) -> Floats:
    """(12 * count, 3) points on the edges of a box, world frame."""
    points = []
    for axis in range(3):
        for signs in itertools.product((-1.0, 1.0), repeat=2):
            edge = np.zeros((count, 3))
            edge[:, axis] = np.linspace(-1.0, 1.0, count)
            edge[:, (axis + 1) % 3], edge[:, (axis + 2) % 3] = signs
            points.append(edge)
    half = 0.5 * np.array(box.size_m)
    return box.world_from_box.transform_points(half * np.concatenate(points))


@pytest.mark.parametrize("kind", list(RendererKind), ids=lambda kind: kind.value)
@pytest.mark.parametrize("offset_m", [0.0, 9e2, 9e3, 9e4])
def test_object_beside_the_camera_far_from_the_centre_is_displaced_within_the_bound(
    make_renderer: MakeRenderer, kind: RendererKind, offset_m: float
) -> None:
    state = make_state(seed=3)
    viewpoint = state.world_from_mirror.translation
    world_from_cube = Pose.from_rpy(viewpoint + np.array((0.31, 0.12, 0.25)), (0.3, 0.2, 0.9))
    cube = DynamicObject(build_cube_mesh(0.2, (1.0, 1.0, 1.0)), world_from_cube)
    state = replace(state, objects=(cube,))
    side_m = 2.0 * offset_m + 2.0
    corner = viewpoint + np.array((offset_m, 0.7 * offset_m, 0.8))
    floor = Item("floor", Rectangle((side_m, side_m)), Pose(np.eye(3), corner), BLACK)
    world = World("large", (floor,))
    lit, directions = lit_pixels(make_renderer(world, kind), kind, state)
    box = OrientedBox(world_from_cube, (0.2, 0.2, 0.2))
    origins = np.broadcast_to(viewpoint, directions.shape)
    wrong = lit != np.isfinite(box_distances((box,), origins, directions))
    edges = edge_points(box, count=1500) - viewpoint
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    displaced_rad = np.arccos(
        np.clip((directions[wrong] @ edges.T).max(axis=1, initial=-1.0), -1, 1)
    )
    assert lit.any()
    # Points of an edge are 1.4e-4 m apart, 0.35 m away.
    assert displaced_rad.max(initial=0.0) <= frame_bound_rad(world, kind, state) + 2e-4


def test_shipped_scale_costs_thousandths_of_a_pixel() -> None:
    state = CameraState(Pose(np.eye(3), np.array((3.0, -2.0, -0.9))))
    floor = Item("floor", Rectangle((10.0, 8.0)), Pose.identity(), BLACK)
    world = World("field", (floor,))
    for kind, most_px in ((RendererKind.TRACE, 0.002), (RendererKind.RASTER, 0.02)):
        scene_px = bound_frame(world, kind, state).numbers_by_name()["scene_px"]
        assert 0.0 < scene_px < most_px
