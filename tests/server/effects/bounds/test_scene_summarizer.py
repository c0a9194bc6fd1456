"""Bounds of a camera state hold for everything that its image shows, and are not far off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import EFFECT_TYPES, NUM_RINGS, EffectType, SceneSummary
from catoptra_server.effects.bounds.coordinate_rounding import round_away_from_zero, round_twist
from catoptra_server.effects.bounds.distances import image_rings
from catoptra_server.effects.bounds.light_loss import ObjectRadiances, max_radiance
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.simulation.robot_bodies import OmniCameraTower, build_ego_body_mesh
from catoptra_server.world.objects import (
    CameraState,
    DynamicObject,
    build_object_mesh,
    scene_twist_in_mirror,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shapes import Patch
from catoptra_server.world.world_description import AT_REST, Box, Item, Material, Twist, World
from helpers.configs import WORLDS
from helpers.dynamic_objects import P2AT, ROBOT_MESH, TWO_ROBOTS, build_cube_mesh, place_cube
from helpers.effect_measurement import CAMERA, DRIVING_STATE, make_any_effect
from helpers.ring_ranges import min_ring_ranges_m
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_test_world

WHITE = Material((1.0, 1.0, 1.0), unlit=True)


EMPTY = World("nothing", ())


def make_summarizer(world: World) -> SceneSummarizer:
    return SceneSummarizer(build_scene(world), world)


def test_summary_has_the_largest_radiance_and_the_scene_twist() -> None:
    world = make_test_world()
    summary = make_summarizer(world).summarize(DRIVING_STATE, CAMERA)
    scene_radiance = max_radiance(build_scene(world), world)
    assert summary.max_radiance == max(
        scene_radiance,
        *round_away_from_zero((ObjectRadiances(world).max_radiance(DRIVING_STATE.objects),)),
    )
    assert summary.scene_twist == round_twist(scene_twist_in_mirror(DRIVING_STATE))


@pytest.mark.parametrize("kind", EFFECT_TYPES.values(), ids=lambda kind: kind.name)
def test_summary_for_a_criterion_has_what_the_criterion_reads(kind: EffectType) -> None:
    # Also after the robot itself has come into view, which moves numbers among the fields.
    effect, self_view = make_any_effect(kind.name), SelfView()
    summarizer = make_summarizer(make_test_world())
    state = replace(DRIVING_STATE, objects=TWO_ROBOTS[:1], ego_body=TWO_ROBOTS[1])
    whole = summarizer.summarize(state, CAMERA)
    part = summarizer.summarize(state, CAMERA, effect.reads | self_view.reads)
    for shown in (lambda summary: summary, self_view.update_summary):
        assert effect.bound(shown(part), CAMERA) == effect.bound(shown(whole), CAMERA)


def test_summary_of_radiance_alone_has_no_distances() -> None:
    summarizer = make_summarizer(make_test_world())
    summary = summarizer.summarize(CameraState(Pose.identity()), CAMERA, {"max_radiance"})
    assert summary.max_radiance == summarizer.max_radiance
    assert set(summary.min_distances_m) == {math.inf}


def test_summary_computes_nothing_that_no_criterion_reads() -> None:
    summarizer = make_summarizer(make_test_world())
    state = replace(DRIVING_STATE, ego_body=TWO_ROBOTS[1])
    part = summarizer.summarize(state, CAMERA, {"scene_twist"})
    assert part.scene_twist == summarizer.summarize(state, CAMERA).scene_twist
    unread = make_summarizer(make_test_world())
    unread.summarize(state, CAMERA, {"scene_twist"})
    assert "max_radiance" not in vars(unread), "the radiance of the scene is found on demand"
    # Without `SelfView` the own robot is not in view.
    without = summarizer.summarize(state, CAMERA, {"max_radiance", "max_shadow_loss"})
    assert without.ego_body_max_radiance == 0.0
    assert without.ego_body_max_angle_rad == 0.0


def random_pose(rng: np.random.Generator, tilt_rad: float) -> Pose:
    position = (*rng.uniform(-2.0, 2.0, 2), -rng.uniform(0.2, 1.5))
    turn = (*rng.uniform(-tilt_rad, tilt_rad, 2), rng.uniform(-math.pi, math.pi))
    return Pose.from_rpy(position, turn)


def clutter(seed: int) -> World:
    """World of randomly oriented thin bars and plates; one is a hair of 0.1 mm."""
    rng = np.random.default_rng(seed)
    sizes = [(4.0, 1e-4, 1e-4), *np.exp(rng.uniform(math.log(1e-3), math.log(3.0), (25, 3)))]
    items = (
        Item(
            f"box {index}",
            Box(tuple(map(float, size))),
            Pose.from_rpy(rng.uniform(-3.0, 3.0, 3), rng.uniform(-3.0, 3.0, 3)),
            WHITE,
        )
        for index, size in enumerate(sizes)
    )
    return World("clutter", tuple(items))


@pytest.mark.parametrize("tilt_rad", [0.0, 0.4, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_no_ring_shows_anything_nearer_than_its_bound(seed: int, tilt_rad: float) -> None:
    rng = np.random.default_rng(seed)
    world = make_test_world() if seed == 0 else clutter(seed)
    summarizer = make_summarizer(world)
    for index in range(5):
        state = CameraState(random_pose(rng, tilt_rad), TWO_ROBOTS if index % 2 else ())
        bound = np.array(summarizer.summarize(state, CAMERA).min_distances_m)
        assert (bound <= min_ring_ranges_m(world, state)).all()


def ratios(world: World, poses: list[Pose]) -> Floats:
    """Ratios of bounds to the distances in rendered images, for rings that show a surface."""
    summarizer = make_summarizer(world)
    bounds = np.array(
        [summarizer.summarize(CameraState(pose), CAMERA).min_distances_m for pose in poses]
    )
    seen = np.array([min_ring_ranges_m(world, CameraState(pose)) for pose in poses])
    return np.asarray(bounds[np.isfinite(seen)] / seen[np.isfinite(seen)])


@pytest.mark.parametrize("name", ["four_legged_2006", "corridor"])
def test_bounds_in_bundled_worlds_are_mostly_above_half_the_distance(name: str) -> None:
    rng = np.random.default_rng(5)
    reach = (7.0, 0.6) if name == "corridor" else (2.5, 1.5)
    poses = [Pose.from_rpy((*rng.uniform(-1.0, 1.0, 2) * reach, -0.6)) for _ in range(8)]
    shares = ratios(read_world(WORLDS / f"{name}.ini")[0], poses)
    assert shares.max() <= 1.0
    assert np.median(shares) > 0.7
    assert np.quantile(shares, 0.05) > 0.4


def test_object_rates_bound_the_motion_of_visible_parts() -> None:
    summary = make_summarizer(make_test_world()).summarize(DRIVING_STATE, CAMERA)
    (body,) = DRIVING_STATE.objects
    distance = np.linalg.norm(body.centre - DRIVING_STATE.world_from_mirror.translation)
    assert max(summary.max_object_rates_rad_s) >= 0.6 / distance
    still = CameraState(DRIVING_STATE.world_from_mirror, TWO_ROBOTS)
    assert not any(
        make_summarizer(make_test_world()).summarize(still, CAMERA).max_object_rates_rad_s
    )


def test_rings_and_twist_of_a_lens_are_about_its_axis_ahead() -> None:
    wall = Item("wall", Box((0.1, 4.0, 4.0)), Pose.from_rpy((2.05, 0.0, 0.0)), WHITE)
    summarizer = make_summarizer(World("wall", (wall,)))
    lens = PerspectiveCamera(64, 48, 1.2)
    turning = CameraState(Pose.identity(), twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 1.0)))
    summary = summarizer.summarize(turning, lens)
    assert summary.min_distances_m == pytest.approx((2.0,) * NUM_RINGS, rel=0.4)
    assert max(summary.min_distances_m[:2]) <= 2.001
    # Rounded outward: what the lens comes nearer to lies along its axis, and a yaw turns across.
    assert summary.scene_twist.linear_m_s[2] == pytest.approx(-0.5, rel=0.1)
    assert math.hypot(*summary.scene_twist.angular_rad_s[:2]) == pytest.approx(1.0, rel=0.1)
    assert summary.scene_twist.angular_rad_s[2] == 0.0
    away = CameraState(Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, math.pi)))
    assert min(summarizer.summarize(away, lens).min_distances_m) == math.inf


# Rounded up, to eighths of an octave.
COARSE = 2.0**0.125


def max_distance_m(world: World, pose: Pose, *objects: DynamicObject) -> float:
    return make_summarizer(world).summarize(CameraState(pose, objects), CAMERA).max_distance_m


def test_no_surface_is_farther_than_the_bound() -> None:
    scene, pose = build_scene(make_test_world()), CAMERA_STATE.world_from_mirror
    farthest = float(np.linalg.norm(scene.corners - pose.translation, axis=-1).max())
    assert farthest <= max_distance_m(make_test_world(), pose) <= 1.3 * COARSE * farthest


def test_object_beyond_the_scene_counts() -> None:
    bound_m = max_distance_m(make_test_world(), Pose.identity(), place_cube(40.0, 0.0, 0.0))
    assert 40.2 <= bound_m <= 41.0 * COARSE


def test_empty_world_has_distance_zero() -> None:
    assert max_distance_m(EMPTY, Pose.identity()) == 0.0
    near = place_cube(1.0, 0.0, 0.0)
    assert max_distance_m(EMPTY, Pose.identity(), near) == pytest.approx(1.3, rel=0.15)


MIRROR = Pose.from_rpy((0.0, 0.0, -0.4543))
# On the floor of the room, where no thing of it is between mirror and robot.
BASE = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))


def camera_state_of(camera: OmniCamera, mirror: Pose = MIRROR) -> CameraState:
    ego_body = DynamicObject(build_ego_body_mesh(P2AT, OmniCameraTower(camera, mirror)), BASE)
    return CameraState(BASE @ mirror, ego_body=ego_body)


def bound_self_view(state: CameraState, camera: OmniCamera) -> SceneSummary:
    return make_summarizer(EMPTY).summarize(state, camera)


def sampled_angles(corners: Floats) -> tuple[float, float]:
    """Smallest and largest angle from +z of many points of one triangle."""
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 300), np.linspace(0.0, 1.0, 300))
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    points = np.stack((a, b, 1.0 - a - b), axis=-1) @ corners
    angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    return float(angle.min()), float(angle.max())


def max_angle_of_body(corners: Floats, camera: OmniCamera) -> float:
    """Largest angle from the axis of a body of (n, 3, 3) triangles in the mirror frame."""
    mesh = build_object_mesh([(Patch(corners, np.zeros((len(corners), 3, 2))), WHITE)])
    body = DynamicObject(mesh, Pose.identity())
    state = CameraState(Pose.identity(), ego_body=body)
    return bound_self_view(state, camera).ego_body_max_angle_rad


def test_max_angle_of_triangles_is_tight() -> None:
    camera = make_omni_camera(rim_deg=140.0)
    for triangle in np.random.default_rng(2).uniform(-1.0, 1.0, (60, 3, 3)):
        smallest, largest = sampled_angles(triangle)
        if smallest <= camera.rim_rad:
            found = max_angle_of_body(triangle[None], camera)
            assert largest <= found + 1e-9
            assert found - largest < 0.05


def test_triangle_around_the_antipole_reaches_pi_whichever_way_it_is_wound() -> None:
    around = np.array([[(1.0, 0.0, -0.5), (-1.0, 1.0, -0.5), (-1.0, -1.0, -0.5)]])
    for corners in (around, around[:, ::-1]):
        assert max_angle_of_body(corners, make_omni_camera(rim_deg=140.0)) == math.pi


def test_robot_absent_or_beyond_the_rim_is_not_visible() -> None:
    camera = make_omni_camera()
    for ego_body in (None, place_cube(0.0, 0.0, -1.0)):
        reach = bound_self_view(CameraState(Pose.identity(), ego_body=ego_body), camera)
        assert reach.ego_body_max_angle_rad == 0.0
        assert set(reach.ego_body_min_distances_m) == {math.inf}


def test_robot_partly_within_the_rim_is_bounded_beyond_the_rim() -> None:
    narrow = make_omni_camera(rim_deg=5.0)
    reach = bound_self_view(camera_state_of(narrow), narrow)
    assert reach.ego_body_max_angle_rad > narrow.rim_rad
    assert reach.ego_body_min_distances_m[0] == pytest.approx(0.2321)


def test_bound_of_the_p2at_is_its_deck_corner() -> None:
    reach = bound_self_view(camera_state_of(make_omni_camera()), make_omni_camera())
    below_m = 0.4543 + 0.1457 - 0.2913
    inner_m = P2AT.dimensions_m[1] - 2.0 * 0.4 * P2AT.wheel_radius_m
    corner = math.hypot(0.5 * P2AT.dimensions_m[0], 0.5 * inner_m) / below_m
    assert reach.ego_body_max_angle_rad == pytest.approx(math.atan(corner), abs=1e-6)
    assert reach.ego_body_min_distances_m[0] == pytest.approx(0.2321)
    assert reach.ego_body_min_distances_m[-1] == math.inf


def test_bounds_of_a_driving_robot_are_cached() -> None:
    camera = make_omni_camera()
    state = camera_state_of(camera)
    assert state.ego_body is not None
    step = Pose.from_rpy((17.3, -4.1, 0.0), (0.0, 0.0, 2.2))
    moved = DynamicObject(state.ego_body.mesh, step @ state.ego_body.world_from_object)
    later = CameraState(step @ state.world_from_mirror, ego_body=moved)
    found = [bound_self_view(one, camera).ego_body_min_distances_m for one in (state, later)]
    assert found[0] is found[1]


@pytest.mark.parametrize("ring", [0, 1])
def test_ring_distances_do_not_exceed_those_of_points(ring: int) -> None:
    camera = make_omni_camera(width_px=96)
    state = camera_state_of(camera)
    mesh = state.ego_body.mesh if state.ego_body else build_cube_mesh(1.0)
    local = MIRROR.inverse().transform_points(mesh.corners).reshape(-1, 3)
    theta = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    ratio = camera.projection.radius_ratio_from_t(np.tan(0.5 * theta))
    share = ratio * camera.horizon_radius_px / camera.rim_radius_px
    of_ring = local[np.floor(share * NUM_RINGS).astype(int) == ring]
    reach = bound_self_view(state, camera)
    assert reach.ego_body_min_distances_m[ring] <= np.linalg.norm(of_ring, axis=-1).min() + 1e-9


def test_nearest_part_under_an_orthographic_camera_is_the_deck() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0)
    reach = bound_self_view(camera_state_of(camera), camera)
    assert reach.ego_body_min_distances_m[0] == pytest.approx(0.4543 + 0.1457 - 0.2913)


EDGES_RAD = image_rings(make_omni_camera()).edges_rad
LEVEL = int(np.searchsorted(EDGES_RAD, 0.5 * np.pi)) - 1


def around(*objects: DynamicObject, pose: Pose | None = None) -> tuple[Floats, Floats]:
    """Distances and rates by ring about a viewpoint, rounded outward."""
    state = CameraState(pose or Pose.identity(), objects)
    summary = make_summarizer(EMPTY).summarize(state, make_omni_camera())
    return np.array(summary.min_distances_m), np.array(summary.max_object_rates_rad_s)


def cube_ahead(twist: Twist = AT_REST) -> DynamicObject:
    return DynamicObject(build_cube_mesh(0.4), Pose.from_rpy((1.2, 0.0, 0.0)), twist)


def test_cube_ahead_is_as_far_as_its_face() -> None:
    nearest, passing = around(cube_ahead())
    assert 0.999 / COARSE < nearest[LEVEL] <= 1.0
    assert np.isinf(nearest[0])
    assert not passing.any()


def test_crossing_object_passes_at_speed_over_distance() -> None:
    _, passing = around(cube_ahead(Twist((0.0, 0.5, 0.0))))
    assert 0.5 <= passing[LEVEL] < 0.501 * COARSE
    assert passing[0] == 0.0


def test_turning_object_passes_with_its_farthest_corner() -> None:
    _, passing = around(cube_ahead(Twist((0.0,) * 3, (0.0, 0.0, 2.0))))
    assert 2.0 * 0.2 * np.sqrt(2.0) < passing[LEVEL] < 2.0 * 0.2 * np.sqrt(3.0) * 1.001 * COARSE


def test_no_corner_of_a_robot_is_nearer_than_its_ring_bound() -> None:
    pose = Pose(np.eye(3), CAMERA_STATE.world_from_mirror.translation)
    bounds = np.append(around(*TWO_ROBOTS, pose=pose)[0], 0.0)
    for body in TWO_ROBOTS:
        corners = body.world_from_object.transform_points(ROBOT_MESH.corners.reshape(-1, 3))
        points = corners - pose.translation
        theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
        ring = np.searchsorted(EDGES_RAD[1:], theta)
        assert (np.linalg.norm(points, axis=-1) >= bounds[ring]).all()
