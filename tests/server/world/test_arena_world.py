"""The rescue arena: written by its script, with ramps of the stated slopes, closed, and starts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.landmarks import BAND_COLOURS
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.ray_caster import SceneRayCaster, commit_ray_caster
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.arena_world import LANDMARKS, STARTS, WORLD, format_landmarks, format_world

# The kernel's rays are float32.
TOLERANCE_M = 1e-5
UP, DOWN = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)

# Name: foot x and y, direction uphill in degrees, width, run, slope in degrees.
RAMPS = {
    "continuous": (-5.2, -2.4, 90, 2.4, 1.2, 15),
    "continuous, falling": (-5.2, 0.0, -90, 2.4, 1.2, 15),
    "crossing, lane 1": (4.3, -2.4, 90, 0.6, 1.2, 15),
    "crossing, lane 2": (4.9, 1.2, -90, 0.6, 1.2, 15),
    "inclined plane 25": (-3.45, 4.7 - 2.144507, 90, 0.9, 2.144507, 25),
    "inclined plane 35": (-2.55, 4.7 - 1.428148, 90, 0.9, 1.428148, 35),
    "inclined plane 45": (-1.65, 3.7, 90, 0.9, 1.0, 45),
    "platform's": (1.8 + 2.747477, 5.3, 180, 1.2, 2.747477, 20),
}


@pytest.fixture(scope="module")
def world() -> World:
    return read_world(WORLD)[0]


@pytest.fixture(scope="module")
def caster(world: World) -> SceneRayCaster:
    return commit_ray_caster(build_scene(world))


def cast(caster: SceneRayCaster, points: Floats, direction: tuple[float, ...]) -> Floats:
    """Distances along one direction from (n, 3) points."""
    return caster.distances(points, np.tile(direction, (len(points), 1)))


def test_files_are_what_the_script_writes() -> None:
    assert WORLD.read_bytes() == format_world().encode()
    assert LANDMARKS.read_bytes() == format_landmarks().encode()


def test_arena_has_many_classes_victims_and_a_beacon_of_each_pair_of_colours(world: World) -> None:
    assert len({item.class_name for item in world.items}) >= 12
    assert len([victim for victim in world.victims if victim.name == "Chest"]) == 2
    pairs = {(landmark.lower_colour, landmark.upper_colour) for landmark in world.landmarks}
    assert pairs == {(a, b) for a in BAND_COLOURS for b in BAND_COLOURS if a != b}


@pytest.mark.parametrize("name", RAMPS)
def test_ramp_rises_by_its_slope(caster: SceneRayCaster, name: str) -> None:
    foot_x, foot_y, uphill_deg, width, run, slope_deg = RAMPS[name]
    tangent, uphill = math.tan(math.radians(slope_deg)), math.radians(uphill_deg)
    # Not over the foot, where a neighbour leans out.
    shares, sides = np.meshgrid((0.35, 0.5, 0.7, 0.99), (-0.45, 0.0, 0.45))
    forward, aside = shares.ravel() * run, sides.ravel() * width
    x = foot_x + forward * math.cos(uphill) - aside * math.sin(uphill)
    y = foot_y + forward * math.sin(uphill) + aside * math.cos(uphill)
    heights = 2.0 - cast(caster, np.column_stack((x, y, np.full_like(x, -2.0))), DOWN)
    np.testing.assert_allclose(heights, forward * tangent, atol=TOLERANCE_M)


@pytest.mark.parametrize("x_m", [-6.4, 4.0])
def test_solid_ramps_are_closed_at_their_sides(caster: SceneRayCaster, x_m: float) -> None:
    y = np.linspace(-2.35, 2.35, 48)  # not at the valleys, where there is no side
    # Just under the surface, found from above, 1 cm within the side.
    high = np.column_stack((np.full_like(y, x_m + 0.01), y, np.full_like(y, -0.7)))
    height = 0.7 - cast(caster, high, DOWN)
    for share in (0.1, 0.9):
        outside = np.column_stack((np.full_like(y, x_m - 0.05), y, -share * height))
        distances = cast(caster, outside, (1.0, 0.0, 0.0))
        np.testing.assert_allclose(distances, 0.05, atol=TOLERANCE_M)


def test_low_step_field_rises_by_single_steps_of_5_cm(caster: SceneRayCaster) -> None:
    x, y = np.meshgrid(4.15 + 0.1 * np.arange(14), -4.15 - 0.1 * np.arange(12), indexing="ij")
    points = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, -2.0)))
    steps = (2.0 - cast(caster, points, DOWN).reshape(x.shape)) / 0.05
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3)
    assert set(np.rint(steps).ravel()) == {0.0, 1.0, 2.0, 3.0, 4.0}
    assert np.abs(np.diff(steps, axis=0)).max() < 1.001
    assert np.abs(np.diff(steps[1:-1], axis=1)).max() < 1.001


@pytest.mark.parametrize("start", STARTS, ids=lambda start: start[0])
def test_start_is_on_the_surface_below_it(
    caster: SceneRayCaster, start: tuple[str, float, float, float, float]
) -> None:
    point = np.array([(start[1], start[2], start[3] - 0.01)])
    assert cast(caster, point, DOWN)[0] == pytest.approx(0.01, abs=TOLERANCE_M)
    assert cast(caster, point, UP)[0] > 0.7
