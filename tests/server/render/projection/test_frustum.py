"""Near and far planes around surfaces, and the projection of a perspective camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.projection.frustum import (
    MAX_NEAR_M,
    DepthRange,
    DepthRangeFinder,
    make_lens_projection,
)
from catoptra_server.world.triangles import make_clusters

SPREAD = math.sqrt(3.0)


def find_near_and_far(corners: Floats, viewpoint: tuple[float, float, float]) -> DepthRange:
    chunks = make_clusters(corners, np.zeros(len(corners), dtype=np.intp))
    surroundings = DepthRangeFinder(chunks, corners)
    return surroundings.find_range(np.asarray(viewpoint, dtype=np.float64), max_depth_ratio=SPREAD)


def make_wall(turn_rad: float) -> Floats:
    """Two triangles of an upright wall 4 m x 2 m through the origin, rotated about z."""
    corners = np.array([[[-2, 0, -1], [2, 0, -1], [2, 0, 1]], [[-2, 0, -1], [2, 0, 1], [-2, 0, 1]]])
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("turn_rad", [0.0, 0.3, 0.25 * math.pi])
@pytest.mark.parametrize("distance", [0.01, 0.05])
def test_near_plane_lies_before_a_wall_however_it_is_turned(
    turn_rad: float, distance: float
) -> None:
    place = (-distance * math.sin(turn_rad), distance * math.cos(turn_rad), 0.1)
    depth = find_near_and_far(make_wall(turn_rad), place)
    assert depth.near_m == pytest.approx(distance / SPREAD)


def test_near_plane_in_the_open_is_as_far_as_it_is_of_use() -> None:
    assert find_near_and_far(make_wall(0.0), (0.0, 3.0, 0.0)).near_m == MAX_NEAR_M


def test_near_plane_in_a_surface_is_the_nearest() -> None:
    assert find_near_and_far(make_wall(0.0), (0.0, 0.0, 0.0)).near_m == 0.001


def test_far_plane_contains_the_farthest_corner() -> None:
    depth = find_near_and_far(make_wall(0.0), (30.0, 40.0, 0.0))
    assert depth.far_m > math.hypot(32.0, 40.0, 1.0)
    assert depth.far_m < 1.02 * math.hypot(32.0, 40.0, 1.0)


def test_range_of_an_empty_scene_is_a_range() -> None:
    depth = find_near_and_far(np.zeros((0, 3, 3)), (0.0, 0.0, 0.0))
    assert 0.0 < depth.near_m < depth.far_m


def test_clip_depth_is_minus_w_and_w_on_the_planes() -> None:
    depth = DepthRange(0.01, 50.0)
    a, b = depth.clip_z_from_w
    assert a * 0.01 + b == pytest.approx(-0.01)
    assert a * 50.0 + b == pytest.approx(50.0)


def test_objects_beyond_the_scene_widen_the_range() -> None:
    at = np.array([0.0, 3.0, 0.0])
    corners = make_wall(0.0)
    surroundings = DepthRangeFinder(make_clusters(corners, np.zeros(2, dtype=np.intp)), corners)
    depth = surroundings.find_range(at, max_depth_ratio=SPREAD, object_distances_m=(0.05, 70.0))
    assert depth.near_m == pytest.approx(0.05 / SPREAD)
    assert depth.far_m > 70.0


def test_objects_in_an_empty_scene_have_a_range_of_their_own() -> None:
    corners = np.zeros((0, 3, 3))
    surroundings = DepthRangeFinder(make_clusters(corners, np.zeros(0, dtype=np.intp)), corners)
    depth = surroundings.find_range(
        np.zeros(3), max_depth_ratio=SPREAD, object_distances_m=(0.05, 70.0)
    )
    assert depth.near_m == pytest.approx(0.05 / SPREAD)
    assert depth.far_m > 70.0


CAMERA = PerspectiveCamera(320, 200, math.radians(100.0))


@pytest.mark.parametrize("turn", [None, MIRROR_FROM_FACE_ROTATIONS[Face.E]])
def test_projection_puts_a_direction_on_its_pixel(turn: np.ndarray[tuple[int, int]] | None) -> None:
    cell = make_lens_projection(CAMERA, 3, turn, max_texels=4096)
    pixel = np.random.default_rng(8).uniform((0.0, 0.0), (320.0, 200.0), (500, 2))
    direction, _ = CAMERA.direction_from_pixel(pixel)
    in_mirror = direction if turn is None else direction @ turn.T
    x, y, w = cell.clip_from_mirror @ in_mirror.T
    shown = 0.5 * (np.stack((x / w, y / w), axis=-1) + 1.0) * (320.0, 200.0)
    np.testing.assert_allclose(shown, pixel, atol=1e-10)


def test_max_depth_ratio_is_the_corner_s() -> None:
    corner, _ = CAMERA.direction_from_pixel(np.array([0.0, 0.0]))
    assert make_lens_projection(CAMERA, 1, max_texels=4096).max_depth_ratio == pytest.approx(
        1.0 / corner[0]
    )


def test_samples_make_the_texture_larger() -> None:
    cell = make_lens_projection(CAMERA, 3, max_texels=960)
    assert cell.viewport == (0, 0, 960, 600)
    assert cell.cells == (cell,)


def test_texture_that_is_too_large_is_rejected_with_the_limit() -> None:
    with pytest.raises(DomainError, match="allows 959 px"):
        make_lens_projection(CAMERA, 3, max_texels=959)
