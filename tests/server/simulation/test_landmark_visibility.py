"""Landmarks in view, in rooms and behind boxes of exact geometry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, SphericalMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim, direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.simulation.sensors.sensor import (
    EMPTY_ENVIRONMENT,
    EmptyScene,
    SensorEnvironment,
)
from catoptra_server.simulation.sight import (
    LandmarkVisibility,
    compute_landmark_visibility,
)
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import build_scene, items_from_landmark
from catoptra_server.world.world_description import World
from helpers.mirror_checks import make_camera

BEACON = Landmark("b", "beacon", 2.0, 0.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")
GOAL = Landmark("g", "goal", 2.7, 0.0, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")
GREY = {"cyan": (0.5, 0.5, 0.5), "yellow": (0.5, 0.5, 0.5)}
OMNI = OmniCameraSpec(
    camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=200, height_px=200, rim_rad=math.radians(120.0)
    ),
    RenderSettings(),
)
PERSPECTIVE = PerspectiveCameraSpec(PerspectiveCamera(320, 240, 1.2))
HEIGHT_M = 0.5


def compute_visibility(
    camera_spec: CameraSpec,
    landmark: Landmark,
    *,
    environment: SensorEnvironment = EMPTY_ENVIRONMENT,
    x_m: float = 0.0,
    yaw_rad: float = 0.0,
) -> LandmarkVisibility:
    """Visibility of one landmark from a camera 0.5 m above the floor."""
    pose = Pose.from_rpy((x_m, 0.0, -HEIGHT_M), (0.0, 0.0, yaw_rad))
    (found,) = compute_landmark_visibility(camera_spec, pose, [landmark], environment)
    return found


def environment_of_landmark(landmark: Landmark) -> SensorEnvironment:
    """Scene of the landmark alone, as rendered."""
    world = World("field", items_from_landmark(landmark, GREY))
    return SensorEnvironment(EmbreeRayCaster(build_scene(world)))


def test_pixel_in_a_perspective_camera_is_the_projection_of_the_band() -> None:
    found = compute_visibility(PERSPECTIVE, BEACON)
    focal_px = 160.0 / math.tan(0.6)
    assert found.pixel == pytest.approx((160.0, 120.0 + focal_px * 0.2 / 2.0))
    assert found.is_visible


def test_pixel_in_an_omni_camera_has_the_direction_of_the_band() -> None:
    found = compute_visibility(OMNI, BEACON, yaw_rad=2.0)
    assert found.pixel is not None
    ray, valid = direction_from_pixel(OMNI.camera, np.array(found.pixel))
    assert valid
    ahead = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)).rotate_directions(ray)
    assert ahead == pytest.approx(np.array((2.0, 0.0, 0.2)) / math.hypot(2.0, 0.2))


@pytest.mark.parametrize("yaw_rad", [math.pi, 0.7, -0.7])
def test_landmark_outside_a_perspective_image_has_no_pixel(yaw_rad: float) -> None:
    assert compute_visibility(PERSPECTIVE, BEACON, yaw_rad=yaw_rad) == LandmarkVisibility(
        BEACON, None, False
    )


@pytest.mark.parametrize(("box_x_m", "visible"), [(1.0, False), (1.5, False), (3.0, True)])
def test_landmark_behind_a_robot_is_occluded(box_x_m: float, visible: bool) -> None:
    box = OrientedBox(Pose.from_rpy((box_x_m, 0.0, -0.4)), (0.3, 0.3, 0.8))
    found = compute_visibility(
        PERSPECTIVE, BEACON, environment=SensorEnvironment(EmptyScene(), (box,))
    )
    assert found.pixel is not None
    assert found.is_visible is visible


@pytest.mark.parametrize(
    ("x_m", "width_m"), [(0.0, 0.1), (1.5, 0.1), (1.949, 0.1), (0.0, 0.5), (1.749, 0.5)]
)
def test_beacon_behind_its_own_surface_only_is_visible(x_m: float, width_m: float) -> None:
    beacon = dataclasses.replace(BEACON, width_m=width_m)
    assert compute_visibility(
        OMNI, beacon, environment=environment_of_landmark(beacon), x_m=x_m
    ).is_visible


@pytest.mark.parametrize(("x_m", "visible"), [(0.0, True), (3.5, False)])
def test_goal_from_behind_is_occluded_by_its_own_back(x_m: float, visible: bool) -> None:
    low = dataclasses.replace(GOAL, band_top_m=0.6)
    assert (
        compute_visibility(OMNI, low, environment=environment_of_landmark(low), x_m=x_m).is_visible
        is visible
    )


def test_landmark_is_seen_from_the_mirror_s_point_where_there_is_no_viewpoint() -> None:
    # A ball of 0.2 m radius: seen from its surface, not from the viewpoint 0.1 m within.
    camera = make_camera(SphericalMirror(0.2, 2.0), 400)
    spec = OmniCameraSpec(camera, RenderSettings())
    near = dataclasses.replace(BEACON, x_m=0.6, width_m=0.01)
    found = compute_visibility(spec, near)
    assert found.pixel is not None
    assert found.is_visible
    origin, direction, valid = ray_from_pixel(camera, np.array(found.pixel))
    assert valid
    band = np.array((0.6, 0.0, 0.2))
    assert np.linalg.norm(np.cross(direction, band - origin)) < 1e-9
    # A small box between the viewpoint and the landmark, which the ray passes; one on the ray.
    for middle, visible in ((0.5 * band, True), (0.5 * (origin + band), False)):
        centre = middle + np.array((0.0, 0.0, -HEIGHT_M))
        box = OrientedBox(Pose.from_rpy(centre), (0.01, 0.01, 0.01))
        seen = compute_visibility(
            spec, near, environment=SensorEnvironment(EmptyScene(), (box,))
        ).is_visible
        assert seen is visible


def test_landmarks_when_there_are_none_are_none() -> None:
    found = compute_landmark_visibility(PERSPECTIVE, Pose.identity(), [], EMPTY_ENVIRONMENT)
    assert found == ()
