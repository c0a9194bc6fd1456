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
from catoptra_server.bounds.self_view_bounds import (
    NOT_VISIBLE,
    bound_self_view,
    max_angle_from_axis,
)
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.robot_shapes import OmniCameraTower, build_ego_body_mesh
from catoptra_server.scene.world_description import World
from helpers.dynamic_objects import P2AT, build_cube_mesh, place_cube
from helpers.worlds import HEMISPHERE_LIGHT, make_omni_camera

MIRROR = Pose.from_rpy((0.0, 0.0, -0.4543))
# On the floor of the room, where no thing of it is between mirror and robot.
BASE = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))
WHITE = World("nothing", (), lights=(HEMISPHERE_LIGHT,), background=(1.0, 1.0, 1.0))


def exposure_of(camera: OmniCamera, mirror: Pose = MIRROR) -> CameraState:
    body = DynamicObject(build_ego_body_mesh(P2AT, OmniCameraTower(camera, mirror)), BASE)
    return CameraState(BASE @ mirror, ego_body=body)


def sampled(corners: Floats) -> tuple[float, float]:
    """Return the least and the largest angle from +z of many points of one triangle."""
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 300), np.linspace(0.0, 1.0, 300))
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    points = np.stack((a, b, 1.0 - a - b), axis=-1) @ corners
    angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    return float(angle.min()), float(angle.max())


def test_angle_of_triangles_when_sampled_is_reached_and_not_exceeded() -> None:
    corners = np.random.default_rng(2).uniform(-1.0, 1.0, (60, 3, 3))
    found = max_angle_from_axis(corners)
    for triangle, angle in zip(corners, found, strict=True):
        largest = sampled(triangle)[1]
        assert largest <= angle + 1e-9
        assert angle - largest < 0.05


def test_triangle_when_it_lies_straight_behind_reaches_the_pole() -> None:
    around = np.array([[(1.0, 0.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)]])
    assert max_angle_from_axis(around)[0] == math.pi
    assert max_angle_from_axis(around[:, ::-1])[0] == math.pi, "whichever way it is wound"


def test_robot_when_it_has_none_or_is_beyond_the_rim_is_not_seen() -> None:
    camera = make_omni_camera()
    above = CameraState(Pose.identity(), ego_body=place_cube(0.0, 0.0, -1.0))
    assert bound_self_view(CameraState(Pose.identity()), camera) == NOT_VISIBLE
    assert bound_self_view(above, camera) == NOT_VISIBLE


def test_robot_when_only_its_camera_is_within_the_rim_reaches_beyond_it() -> None:
    narrow = make_omni_camera(rim_deg=5.0)
    reach = bound_self_view(exposure_of(narrow), narrow)
    assert reach.max_angle_rad > narrow.rim_rad
    assert reach.min_distances_m[0] == pytest.approx(0.2321)


def test_reach_of_the_p2at_is_that_of_its_decks_corner() -> None:
    reach = bound_self_view(exposure_of(make_omni_camera()), make_omni_camera())
    below_m = 0.4543 + 0.1457 - 0.2913
    inner_m = P2AT.dimensions_m[1] - 2.0 * 0.4 * P2AT.wheel_radius_m
    corner = math.hypot(0.5 * P2AT.dimensions_m[0], 0.5 * inner_m) / below_m
    assert reach.max_angle_rad == pytest.approx(math.atan(corner), abs=1e-6)
    assert reach.min_distances_m[0] == pytest.approx(0.2321)
    assert reach.min_distances_m[-1] == math.inf


def test_reach_when_the_robot_drives_on_stays_the_same_numbers() -> None:
    camera = make_omni_camera()
    exposure = exposure_of(camera)
    assert exposure.ego_body is not None
    step = Pose.from_rpy((17.3, -4.1, 0.0), (0.0, 0.0, 2.2))
    moved = DynamicObject(exposure.ego_body.mesh, step @ exposure.ego_body.world_from_object)
    later = CameraState(step @ exposure.world_from_mirror, ego_body=moved)
    assert bound_self_view(later, camera) is bound_self_view(exposure, camera)


@pytest.mark.parametrize("ring", [0, 1])
def test_distances_by_ring_are_not_more_than_what_is_there(ring: int) -> None:
    camera = make_omni_camera(width_px=96)
    exposure = exposure_of(camera)
    mesh = exposure.ego_body.mesh if exposure.ego_body else build_cube_mesh(1.0)
    local = MIRROR.inverse().transform_points(mesh.corners).reshape(-1, 3)
    theta = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    ratio = camera.mirror.radius_ratio_from_t(np.tan(0.5 * theta))
    share = ratio * camera.horizon_radius_px / camera.rim_radius_px
    of_ring = local[np.floor(share * NUM_RINGS).astype(int) == ring]
    reach = bound_self_view(exposure, camera)
    assert reach.min_distances_m[ring] <= np.linalg.norm(of_ring, axis=-1).min() + 1e-9


def test_orthographic_cameras_robot_when_looked_at_is_its_deck() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0)
    reach = bound_self_view(exposure_of(camera), camera)
    assert reach.min_distances_m[0] == pytest.approx(0.4543 + 0.1457 - 0.2913)
