"""Directions, ranges, names and bounds at points of an image."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.simulation.pixel_view import (
    OUTSIDE,
    NamedScene,
    PixelView,
    look_through_pixel,
)
from helpers.room_ray_caster import make_room_world, oriented_box_at
from helpers.worlds import make_plan

OMNI = OmniCameraSpec(
    camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=200, height_px=200, rim_rad=math.radians(120.0)
    ),
    RenderSettings(),
)
PERSPECTIVE = PerspectiveCameraSpec(PerspectiveCamera(320, 240, 1.2))
SCENE = build_scene(make_room_world())
# The optical axis down: the frame of an upright robot's mirror.
POSE = Pose.from_rpy((0.5, 0.0, 0.0))


def look(
    camera: CameraSpec, point_px: tuple[float, float], robots: dict[str, OrientedBox] | None = None
) -> PixelView:
    boxes = robots or {}
    things = NamedScene(SCENE, EmbreeRayCaster(SCENE), tuple(boxes), tuple(boxes.values()))
    return look_through_pixel(camera, POSE, point_px, things, None)


def pixel_of(direction: tuple[float, float, float]) -> tuple[float, float]:
    (u, v), valid = pixel_from_direction(OMNI.camera, np.array(direction))
    assert valid
    return float(u), float(v)


def test_pixel_of_a_wall_has_its_direction_range_and_name() -> None:
    view = look(OMNI, pixel_of((0.0, 1.0, 0.0)))
    assert view.theta_rad == pytest.approx(0.5 * math.pi)
    assert view.azimuth_rad == pytest.approx(0.5 * math.pi)
    assert view.range_m == pytest.approx(3.0, abs=1e-4)
    assert view.object_name == "wall 1 1"
    assert view.bound_px is None


def test_nearer_robot_hides_the_wall() -> None:
    point_px = pixel_of((1.0, 0.0, 0.0))
    view = look(OMNI, point_px, {"near": oriented_box_at(2.0, 0.0), "far": oriented_box_at(3.0, 0)})
    assert (view.object_name, view.range_m) == ("near", pytest.approx(1.3, abs=1e-6))
    behind = look(OMNI, point_px, {"behind": oriented_box_at(-2.0, 0.0)})
    assert behind.object_name == "wall 0 1"


@pytest.mark.parametrize("point_px", [(1.0, 1.0), (-1.0, 100.0), (100.0, 201.0), (math.inf, 0.0)])
def test_pixel_outside_the_mirror_or_the_image_shows_nothing(
    point_px: tuple[float, float],
) -> None:
    assert look(OMNI, point_px) == OUTSIDE


def test_perspective_camera_looks_along_its_axis() -> None:
    view = look(PERSPECTIVE, (160.0, 120.0))
    assert view.theta_rad == pytest.approx(0.0, abs=1e-12)
    assert view.range_m == pytest.approx(3.5, abs=1e-4)
    right = look(PERSPECTIVE, (320.0, 120.0))
    assert right.theta_rad == pytest.approx(0.6)
    assert right.azimuth_rad == pytest.approx(0.0)


def test_bound_at_a_pixel_is_that_of_its_place() -> None:
    plan = make_plan(OMNI.camera, Tessellation(8, 8), samples=2)
    bound = error_bound(OMNI.camera, plan)
    things = NamedScene(SCENE, EmbreeRayCaster(SCENE), (), ())
    at_centre = look_through_pixel(OMNI, POSE, (100.0, 101.0), things, bound)
    at_rim = look_through_pixel(OMNI, POSE, (100.0, 1.0), things, bound)
    assert at_centre.bound_px is not None
    assert at_rim.bound_px is not None
    assert at_centre.bound_px < at_rim.bound_px <= bound.outline_error_px
