"""Worlds in which the proof that a surface fills a part of an image is hard, one by one.

C code: `src/coverage.c`. Filled and traced images are equal to the byte.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.ray_table import lens_ray_table
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
    World,
)
from helpers.dynamic_objects import place_cube
from helpers.trace_kernels import count_differences, fill_and_trace, make_omni_table
from helpers.worlds import CAMERA_STATE

RED = Material((0.8, 0.1, 0.1), unlit=True)
GREEN = Material((0.1, 0.8, 0.1), unlit=True)
BLUE = Material((0.1, 0.1, 0.8), unlit=True)
ABOVE_FLOOR = CameraState(Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)))

TABLES = {
    "omni": make_omni_table(width_px=72),
    "omni, 4 samples": make_omni_table(width_px=58, samples=2),
    "omni, 16 samples": make_omni_table(width_px=32, samples=4),
    "rim at 150": make_omni_table(width_px=90, rim_deg=150.0),
}


def make_item(shape: Shape, pose: Pose, material: Material = RED) -> Item:
    return Item("i", shape, pose, material)


def make_unlit_world(*items: Item) -> World:
    return World("w", items, background=(0.2, 0.3, 0.9))


def lines_on(floor: Shape, *others: Item) -> World:
    """Lines of 5 cm, a millimetre above a floor."""
    lines = [
        make_item(
            Rectangle((3.0, 0.05)),
            Pose.from_rpy((0.1 * k, 0.4 * k, -1e-3), (0.0, 0.0, 0.2 + k)),
            GREEN,
        )
        for k in range(-3, 4)
    ]
    return make_unlit_world(make_item(floor, Pose.identity()), *lines, *others)


@pytest.mark.parametrize("side_m", [20.0, 1e3, 5e3, 2e4])
def test_line_on_a_floor_when_the_floor_is_large_is_not_hidden(side_m: float) -> None:
    world = lines_on(Rectangle((side_m, side_m)))
    assert count_differences(world, ABOVE_FLOOR, TABLES["omni"]) == 0


@pytest.mark.parametrize("radius_m", [100.0, 1e3, 2e4])
def test_line_on_a_floor_when_a_dome_is_far_is_not_hidden(radius_m: float) -> None:
    dome = make_item(SphereBand(radius_m, 0.0, 3.1, 24, 12), Pose.identity(), BLUE)
    world = lines_on(Rectangle((20.0, 20.0)), dome)
    assert count_differences(world, ABOVE_FLOOR, TABLES["omni"]) == 0


def test_surface_when_it_occurs_twice_ends_at_its_border() -> None:
    floor = make_item(Rectangle((2.0, 1.3)), Pose.identity())
    assert count_differences(make_unlit_world(floor, floor), ABOVE_FLOOR, TABLES["omni"]) == 0


@pytest.mark.parametrize("aside_m", [0.0, 1e-7, 1e-6])
def test_viewpoint_when_it_lies_on_a_surface_proves_nothing_by_its_rounding(aside_m: float) -> None:
    turned = Pose.from_rpy((0.0, 0.0, aside_m), (0.0, 0.0, 0.3))
    sheet = make_item(Rectangle((3.0, 2.0)), CAMERA_STATE.world_from_mirror @ turned, GREEN)
    floor = make_item(Rectangle((9.0, 9.0)), Pose.identity())
    for world in (make_unlit_world(floor, sheet), make_unlit_world(sheet)):
        for table in ("rim at 150", "omni, 16 samples"):
            assert count_differences(world, CAMERA_STATE, TABLES[table]) == 0


@pytest.mark.parametrize("material", [RED, BLUE], ids=["same colour", "other colour"])
def test_neighbours_in_one_plane_are_told_apart_by_their_edge(material: Material) -> None:
    left = make_item(Rectangle((2.0, 2.0)), Pose.from_rpy((0.0, -1.0, 0.0)))
    right = make_item(Rectangle((2.0, 2.0)), Pose.from_rpy((0.0, 1.0, 0.0)), material)
    assert count_differences(make_unlit_world(left, right), ABOVE_FLOOR, TABLES["omni"]) == 0


def test_hole_in_a_surface_shows_what_lies_behind() -> None:
    ring = make_item(Ring(0.02, 5.0, sectors=40), Pose.from_rpy((0.3, 0.2, -0.1)))
    floor = make_item(Rectangle((12.0, 12.0)), Pose.identity(), BLUE)
    assert count_differences(make_unlit_world(ring, floor), ABOVE_FLOOR, TABLES["omni"]) == 0


def test_edge_when_it_passes_through_the_corner_of_a_beam_is_left_to_rays() -> None:
    # One tile, whose corner rays are the edges of its pyramid; larger parts bulge beyond theirs.
    camera = PerspectiveCamera(4, 4, 0.2)
    table = lens_ray_table(camera, 2)
    # Rounding decides whether the ray meets such an edge; it must not whether the beam does.
    assert [
        seed
        for seed in range(200)
        if count_differences(*make_wall_up_to_a_ray(camera, seed), table)
    ] == []


def make_wall_up_to_a_ray(camera: PerspectiveCamera, seed: int) -> tuple[World, CameraState]:
    """A wall with an oblique edge through the ray of the first sample."""
    rng = np.random.default_rng(seed)
    state = CameraState(Pose.from_rpy(tuple(rng.uniform(-1, 1, 3)), tuple(rng.uniform(-3, 3, 3))))
    towards = camera.direction_from_pixel(np.array((0.25, 0.25)))[0]
    # Eight metres along and across, at 45 degrees, with the middle of one side on the ray.
    at = 3.0 * towards / towards[0] + 4.0 * np.sqrt(0.5) * np.array((0.0, 1.0, 1.0))
    turned = Pose.from_rpy(tuple(at), (0.25 * np.pi, 0.0, 0.0))
    upright = turned @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.5 * np.pi, 0.0))
    wall = make_item(Rectangle((8.0, 8.0)), state.world_from_mirror @ upright)
    return make_unlit_world(wall), state


def test_small_triangles_that_pierce_a_floor_from_below_are_seen() -> None:
    # The spheres around the caps have their centres below the floor.
    rng = np.random.default_rng(5)
    balls = [
        make_item(
            SphereBand(0.15, 0.0, 3.1, 40, 30),
            Pose.from_rpy((*rng.uniform(-1.5, 1.5, 2), float(rng.uniform(0.12, 0.149)))),
            GREEN,
        )
        for _ in range(16)
    ]
    floor = make_item(Rectangle((9.0, 9.0)), Pose.identity())
    world = make_unlit_world(floor, *balls)
    for table in ("omni", "rim at 150", "omni, 4 samples"):
        assert count_differences(world, ABOVE_FLOOR, TABLES[table]) == 0


def test_confetti_far_from_the_centres_of_its_spheres_is_seen() -> None:
    rng = np.random.default_rng(6)
    confetti = [
        make_item(
            Box(tuple(rng.uniform(0.01, 0.03, 3))),
            Pose.from_rpy((*rng.uniform(-2.0, 2.0, 2), float(rng.uniform(-0.4, -0.1)))),
            GREEN,
        )
        for _ in range(600)
    ]
    world = make_unlit_world(make_item(Rectangle((9.0, 9.0)), Pose.identity()), *confetti)
    for table in ("omni", "rim at 150", "omni, 4 samples"):
        assert count_differences(world, ABOVE_FLOOR, TABLES[table]) == 0


def test_object_when_it_surrounds_the_viewpoint_hides_all() -> None:
    state = replace(ABOVE_FLOOR, objects=(place_cube(0.31, 0.17, -0.6),))
    world = lines_on(Rectangle((9.0, 9.0)))
    filled, traced, share = fill_and_trace(world, state, TABLES["omni"])
    assert share == 0.0
    np.testing.assert_array_equal(filled, traced)
    assert set(np.unique(filled[..., 1])) == {0}


def test_box_from_inside_is_filled_but_for_its_edges() -> None:
    room = make_unlit_world(make_item(Box((4.0, 3.0, 2.0)), Pose.identity()))
    filled, traced, share = fill_and_trace(room, CAMERA_STATE, TABLES["rim at 150"])
    np.testing.assert_array_equal(filled, traced)
    assert share > 0.4
