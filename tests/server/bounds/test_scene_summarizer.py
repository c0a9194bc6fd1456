from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.bounds import round_outward
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect import NUM_RINGS
from catoptra_server.world.camera_state import CameraState, scene_twist_in_mirror
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.scene_radiance import max_object_radiance, max_radiance
from catoptra_server.world.world_description import Box, Item, Material, Twist, World
from helpers.configs import WORLDS
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.effect_measurement import CAMERA, DRIVING_STATE
from helpers.ring_ranges import min_ring_ranges_m
from helpers.worlds import make_test_world

WHITE = Material((1.0, 1.0, 1.0), unlit=True)


def make_summarizer(world: World) -> SceneSummarizer:
    return SceneSummarizer(build_scene(world), world)


def test_summary_has_the_largest_radiance_and_the_scene_twist() -> None:
    world = make_test_world()
    summary = make_summarizer(world).summarize(DRIVING_STATE, CAMERA)
    scene_radiance = max_radiance(build_scene(world), world)
    assert summary.max_radiance == max(
        scene_radiance,
        *round_outward.round_away_from_zero(
            max_object_radiance(one, world) for one in DRIVING_STATE.objects
        ),
    )
    assert summary.scene_twist == round_outward.round_twist(scene_twist_in_mirror(DRIVING_STATE))


def test_summary_of_radiance_alone_has_no_distances() -> None:
    summarizer = make_summarizer(make_test_world())
    summary = summarizer.summarize_radiance(CameraState(Pose.identity()))
    assert summary.max_radiance == summarizer.max_radiance
    assert set(summary.min_distances_m) == {math.inf}


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


def test_wire_thinner_than_a_pixel_is_bounded() -> None:
    wire = Item("wire", Box((1e-4, 1e-4, 2.0)), Pose.from_rpy((0.8, 0.3, -0.6)), WHITE)
    state = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)))
    world = World("wire", (wire,))
    nearest = make_summarizer(world).summarize(state, CAMERA).min_distances_m
    assert min(nearest) == pytest.approx(math.hypot(0.8, 0.3), rel=0.25)
    assert min(nearest) <= math.hypot(0.8, 0.3)


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
