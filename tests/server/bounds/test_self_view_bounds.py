"""Extent of a robot in its own mirror, by formula and by sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.scene_summarizer import (
    NOT_VISIBLE,
    bound_self_view,
    max_angle_from_axis,
)
from catoptra_server.effects.effect import NUM_RINGS
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.robot_shapes import OmniCameraTower, build_ego_body_mesh
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import P2AT, build_cube_mesh, place_cube
from helpers.worlds import HEMISPHERE_LIGHT, make_omni_camera

MIRROR = Pose.from_rpy((0.0, 0.0, -0.4543))
# On the floor of the room, where no thing of it is between mirror and robot.
BASE = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))
WHITE = World("nothing", (), lights=(HEMISPHERE_LIGHT,), background=(1.0, 1.0, 1.0))


def camera_state_of(camera: OmniCamera, mirror: Pose = MIRROR) -> CameraState:
    ego_body = DynamicObject(build_ego_body_mesh(P2AT, OmniCameraTower(camera, mirror)), BASE)
    return CameraState(BASE @ mirror, ego_body=ego_body)


def sampled_angles(corners: Floats) -> tuple[float, float]:
    """Smallest and largest angle from +z of many points of one triangle."""
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 300), np.linspace(0.0, 1.0, 300))
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    points = np.stack((a, b, 1.0 - a - b), axis=-1) @ corners
    angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    return float(angle.min()), float(angle.max())


def test_max_angle_of_triangles_is_tight() -> None:
    corners = np.random.default_rng(2).uniform(-1.0, 1.0, (60, 3, 3))
    found = max_angle_from_axis(corners)
    for triangle, angle in zip(corners, found, strict=True):
        largest = sampled_angles(triangle)[1]
        assert largest <= angle + 1e-9
        assert angle - largest < 0.05


def test_triangle_around_the_antipole_reaches_pi() -> None:
    around = np.array([[(1.0, 0.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)]])
    assert max_angle_from_axis(around)[0] == math.pi
    assert max_angle_from_axis(around[:, ::-1])[0] == math.pi, "whichever way it is wound"


def test_robot_absent_or_beyond_the_rim_is_not_visible() -> None:
    camera = make_omni_camera()
    above = CameraState(Pose.identity(), ego_body=place_cube(0.0, 0.0, -1.0))
    assert bound_self_view(CameraState(Pose.identity()), camera) == NOT_VISIBLE
    assert bound_self_view(above, camera) == NOT_VISIBLE


def test_robot_partly_within_the_rim_is_bounded_beyond_the_rim() -> None:
    narrow = make_omni_camera(rim_deg=5.0)
    reach = bound_self_view(camera_state_of(narrow), narrow)
    assert reach.max_angle_rad > narrow.rim_rad
    assert reach.min_distances_m[0] == pytest.approx(0.2321)


def test_bound_of_the_p2at_is_its_deck_corner() -> None:
    reach = bound_self_view(camera_state_of(make_omni_camera()), make_omni_camera())
    below_m = 0.4543 + 0.1457 - 0.2913
    inner_m = P2AT.dimensions_m[1] - 2.0 * 0.4 * P2AT.wheel_radius_m
    corner = math.hypot(0.5 * P2AT.dimensions_m[0], 0.5 * inner_m) / below_m
    assert reach.max_angle_rad == pytest.approx(math.atan(corner), abs=1e-6)
    assert reach.min_distances_m[0] == pytest.approx(0.2321)
    assert reach.min_distances_m[-1] == math.inf


def test_bounds_of_a_driving_robot_are_cached() -> None:
    camera = make_omni_camera()
    state = camera_state_of(camera)
    assert state.ego_body is not None
    step = Pose.from_rpy((17.3, -4.1, 0.0), (0.0, 0.0, 2.2))
    moved = DynamicObject(state.ego_body.mesh, step @ state.ego_body.world_from_object)
    later = CameraState(step @ state.world_from_mirror, ego_body=moved)
    assert bound_self_view(later, camera) is bound_self_view(state, camera)


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
    assert reach.min_distances_m[ring] <= np.linalg.norm(of_ring, axis=-1).min() + 1e-9


def test_nearest_part_under_an_orthographic_camera_is_the_deck() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0)
    reach = bound_self_view(camera_state_of(camera), camera)
    assert reach.min_distances_m[0] == pytest.approx(0.4543 + 0.1457 - 0.2913)
