"""The bound of a frame in worlds of up to 200 km, with things up to 2 cm near: never exceeded.

Displacements are angles at the viewpoint, exact for each pixel: beside a disc from its outline,
beside a rectangle from the planes of its edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.coordinate_rounding import UNIT_ROUNDOFF
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
    # Half of the light.
    lit = image.reshape(-1, 3)[on_mirror.ravel(), 0] > 187
    return lit, directions[on_mirror] @ state.world_from_mirror.rotation.T


def frame_bound_rad(world: World, kind: RendererKind, state: CameraState) -> float:
    """Bound of a frame, as the server states it."""
    return math.radians(bound_frame(world, kind, state).geometric.max_deg)


def bound_frame(world: World, kind: RendererKind, state: CameraState) -> ErrorBound:
    scene = build_scene(world)
    errors = coordinate_errors(kind, is_large=scene.is_large)
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
    ("side_m", "distance_m"),
    [(2e2, 0.02), (2e3, 0.02), (2e4, 0.02), (2e5, 0.02), (2e3, 0.3), (2e5, 0.3), (2e4, 5.0)],
)
def test_edge_of_a_large_rectangle_nearby_is_displaced_within_the_bound(
    make_renderer: MakeRenderer, kind: RendererKind, side_m: float, distance_m: float
) -> None:
    seen = 0
    for seed in range(6):
        state = make_state(seed)
        edge = place_edge(state, side_m, distance_m, seed)
        lit, directions = lit_pixels(make_renderer(edge.world, kind), kind, state)
        displaced_rad, is_inside = edge.displacements_rad(lit, directions)
        assert displaced_rad <= frame_bound_rad(edge.world, kind, state)
        seen += int(is_inside.any() and not is_inside.all())
    assert seen >= 4, "the edges are in view"


@dataclass(frozen=True)
class Edge:
    """A white rectangle, of which one edge passes by the viewpoint."""

    world: World
    rotation: Floats
    centre: Floats  # from the viewpoint
    half_m: float

    def displacements_rad(self, lit: Bools, directions: Floats) -> tuple[float, Bools]:
        """Largest displacement of (n, 3) directions, and which of them meet the rectangle."""
        normal = self.rotation[:, 2]
        along = (self.centre @ normal) / (directions @ normal)
        on_plane = (along[:, None] * directions - self.centre) @ self.rotation[:, :2]
        is_inside = (along > 0.0) & (np.abs(on_plane) <= self.half_m).all(axis=1)
        signs = np.array(((1, 1), (1, -1), (-1, -1), (-1, 1)))
        corners = self.centre + self.half_m * signs @ self.rotation[:, :2].T
        wrong = directions[lit != is_inside]
        return edge_angles(wrong, corners, np.roll(corners, -1, axis=0)), is_inside


def place_edge(state: CameraState, side_m: float, distance_m: float, seed: int) -> Edge:
    """Rectangle in a random plane, with an edge beside the foot of its perpendicular."""
    rng, half_m = np.random.default_rng(seed), 0.5 * side_m
    rotation = random_rotation(rng)
    centre = (
        (half_m + distance_m * rng.uniform(-1.0, 1.0)) * rotation[:, 0]
        + half_m * rng.uniform(-0.3, 0.3) * rotation[:, 1]
        - distance_m * rotation[:, 2]
    )
    pose = Pose(rotation, state.world_from_mirror.translation + centre)
    world = World("edge", (Item("edge", Rectangle((side_m, side_m)), pose, WHITE),))
    return Edge(world, rotation, centre, half_m)


# Four of the largest texels of a face: tips are rounded off, and thinner parts may be missing.
THIN_RAD = 0.07


def edge_angles(directions: Floats, first: Floats, second: Floats) -> float:
    """Largest angle between (n, 3) directions and the nearest of (m, 3) edges, from the eye.

    Directions beside two edges at once are left out.
    """
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ends = (np.cross(normals, first), first), (np.cross(second, normals), second)
    is_beside = np.all(
        [directions @ (side / norms(end)).T >= -THIN_RAD for side, end in ends], axis=0
    )
    angles = np.arcsin(np.minimum(np.abs(directions @ normals.T), 1.0))
    nearest, second = np.sort(np.where(is_beside, angles, math.pi), axis=1).T[:2]
    return float(nearest[second > THIN_RAD].max(initial=0.0))


def norms(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True))


# The rasterizer holds corners in 256ths of a pixel: half a step along both sides.
SNAP_PX = math.sqrt(2.0) / 512.0
NARROW = PerspectiveCamera(256, 256, math.radians(2.0))


def aim(edge: Edge, state: CameraState, distance_m: float, seed: int) -> CameraState:
    """State of a camera that looks at a random point of the near edge, at about a distance."""
    rng = np.random.default_rng(seed)
    middle = edge.centre - edge.half_m * edge.rotation[:, 0]
    along = -(middle @ edge.rotation[:, 1])
    along += rng.choice((-1.0, 1.0)) * distance_m * 10.0 ** rng.uniform(-1.0, 1.0)
    ahead = middle + np.clip(along, -edge.half_m, edge.half_m) * edge.rotation[:, 1]
    ahead /= np.linalg.norm(ahead)
    right = np.cross(random_rotation(rng)[:, 0], ahead)
    right /= np.linalg.norm(right)
    rotation = np.stack((ahead, right, np.cross(ahead, right)), axis=1)
    return CameraState(Pose(rotation, state.world_from_mirror.translation))


def measure_ulps(make_renderer: MakeRenderer, size_per_distance: float, seed: int) -> float:
    """Displacement of an edge in raster, in units of 2^-24, without the rasterizer's grid."""
    distance_m = float(np.exp(np.random.default_rng(seed).uniform(math.log(0.02), math.log(5.0))))
    side_m = distance_m * size_per_distance / math.sqrt(2.0)
    state = make_state(seed)
    edge = place_edge(state, side_m, distance_m, seed)
    state = aim(edge, state, distance_m, seed)
    view = make_renderer(edge.world, RendererKind.RASTER).prepare_perspective(NARROW, 1)
    lit = view.render(state).rgb[..., 0].ravel() > 127
    view.close()
    pixels = np.stack(np.meshgrid(*[np.arange(256) + 0.5] * 2), axis=-1).reshape(-1, 2)
    directions = NARROW.direction_from_pixel(pixels)[0] @ state.world_from_mirror.rotation.T
    displaced_rad, _ = edge.displacements_rad(lit, directions)
    return (displaced_rad - SNAP_PX / NARROW.focal_length_px) / UNIT_ROUNDOFF


def test_raster_displaces_edges_by_the_stated_part_of_their_size_and_not_by_far_less(
    make_renderer: MakeRenderer,
) -> None:
    errors = coordinate_errors(RendererKind.RASTER, is_large=True)
    limit = errors.max_size_per_distance
    # Just below what is split, where it is off the most, and far above: of 200 km, 2 cm near.
    sizes = 0.5 * limit, 0.945 * limit, 1e7
    worst_ulps = [
        max(
            measure_ulps(make_renderer, size, seed) / (min(size, limit) + 1.0) for seed in range(40)
        )
        for size in sizes
    ]
    assert max(worst_ulps) <= errors.size_ulps
    # Other drivers and processors err otherwise: of 500 edges the worst had more than a third.
    assert max(worst_ulps) >= errors.size_ulps / 6.0


@pytest.mark.parametrize("extent_m", [2e3, 2e4, 2e5])
def test_raster_is_off_by_hundredths_of_a_pixel_in_worlds_of_any_size(extent_m: float) -> None:
    camera = make_omni_camera(width_px=640)
    state = make_state(0)
    edge = place_edge(state, extent_m, 0.02, 0)
    plan = plan_from_settings(
        RenderSettings(samples=1), camera, kind=RendererKind.RASTER, reason="test"
    )
    angle_rad = SceneSummarizer(build_scene(edge.world), edge.world).max_rounding_angle_rad(
        state, coordinate_errors(plan.renderer, is_large=True)
    )
    bound = add_scene(error_bound(camera, plan), angle_error(camera, angle_rad))
    assert 0.0 < bound.numbers_by_name()["scene_px"] < 0.05


@pytest.mark.parametrize("kind", list(RendererKind), ids=lambda kind: kind.value)
@pytest.mark.parametrize("extent_m", [2.0, 2e5])
@pytest.mark.parametrize(("distance_m", "gap_m"), [(10.0, 0.01), (1e3, 1.0)])
def test_surfaces_close_together_are_drawn_in_their_order_while_something_is_near(
    make_renderer: MakeRenderer,
    kind: RendererKind,
    extent_m: float,
    distance_m: float,
    gap_m: float,
) -> None:
    for seed in range(6):
        rng, state = np.random.default_rng(seed), make_state(seed)
        viewpoint = state.world_from_mirror.translation
        yaw, pitch = rng.uniform(-3.0, 3.0), rng.uniform(0.1, 0.5)
        ahead = np.array((np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)))
        normal = ahead + rng.uniform(-0.6, 0.6, 3)
        normal /= np.linalg.norm(normal)
        right = np.cross(normal, random_rotation(rng)[:, 0])
        right /= np.linalg.norm(right)
        rotation = np.stack((right, np.cross(normal, right), normal), axis=1)
        boards = [
            Item(
                name,
                Rectangle((distance_m, distance_m)),
                Pose(rotation, viewpoint + distance_m * ahead + back_m * normal),
                colour,
            )
            for name, back_m, colour in (("front", 0.0, WHITE), ("back", gap_m, BLACK))
        ]
        near = Pose(np.eye(3), viewpoint - (0.0, 0.0, 0.02))
        floor = Pose(np.eye(3), viewpoint + np.array((0.3 * extent_m, 0.2 * extent_m, -0.5)))
        world = World(
            "boards",
            (
                *boards[:: 1 if seed % 2 else -1],
                Item("thing", Rectangle((0.01, 0.01)), near, BLACK),
                Item("floor", Rectangle((extent_m, extent_m)), floor, BLACK),
            ),
        )
        lit, directions = lit_pixels(make_renderer(world, kind), kind, state)
        along = distance_m * (ahead @ normal) / (directions @ normal)
        on_board = along[:, None] * directions - distance_m * ahead
        across = np.abs(on_board @ rotation[:, :2])
        # The floor is overhead; a texel beside the board's edge is not the board's.
        is_inside = (along > 0.0) & (across < 0.45 * distance_m).all(axis=1)
        is_inside &= directions[:, 2] > 0.02
        assert is_inside.sum() > 200
        assert lit[is_inside].all()


@pytest.mark.parametrize("kind", list(RendererKind), ids=lambda kind: kind.value)
@pytest.mark.parametrize(("offset_m", "size_m"), [(0, 0.2), (9e2, 0.2), (9e4, 0.2), (9e4, 2e2)])
def test_object_beside_the_camera_far_from_the_centre_is_displaced_within_the_bound(
    make_renderer: MakeRenderer, kind: RendererKind, offset_m: float, size_m: float
) -> None:
    state = make_state(seed=3)
    viewpoint = state.world_from_mirror.translation
    turn = Pose.from_rpy(np.zeros(3), (0.3, 0.2, 0.9)).rotation
    # Two centimetres beside a face and an edge of it.
    centre = turn @ (0.5 * size_m + np.array((0.02, -0.03, -0.4 * size_m)))
    world_from_cube = Pose(turn, viewpoint + centre)
    cube = DynamicObject(build_cube_mesh(size_m, (1.0, 1.0, 1.0)), world_from_cube)
    state = replace(state, objects=(cube,))
    side_m = 2.0 * offset_m + 2.0
    corner = viewpoint + np.array((offset_m, 0.7 * offset_m, 0.8 + size_m))
    floor = Item("floor", Rectangle((side_m, side_m)), Pose(np.eye(3), corner), BLACK)
    world = World("large", (floor,))
    lit, directions = lit_pixels(make_renderer(world, kind), kind, state)
    box = OrientedBox(world_from_cube, (size_m, size_m, size_m))
    origins = np.broadcast_to(viewpoint, directions.shape)
    wrong = lit != np.isfinite(box_distances((box,), origins, directions))
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    first, second = np.array(
        [pair for pair in combinations(signs, 2) if sum(pair[0] != pair[1]) == 1]
    ).transpose(1, 0, 2)
    ends = [centre + 0.5 * size_m * end @ turn.T for end in (first, second)]
    assert lit.any()
    assert not lit.all()
    assert edge_angles(directions[wrong], *ends) <= frame_bound_rad(world, kind, state)


def test_shipped_scale_costs_thousandths_of_a_pixel() -> None:
    state = CameraState(Pose(np.eye(3), np.array((3.0, -2.0, -0.9))))
    floor = Item("floor", Rectangle((10.0, 8.0)), Pose.identity(), BLACK)
    world = World("field", (floor,))
    for kind, most_px in ((RendererKind.TRACE, 0.002), (RendererKind.RASTER, 0.02)):
        scene_px = bound_frame(world, kind, state).numbers_by_name()["scene_px"]
        assert 0.0 < scene_px < most_px
