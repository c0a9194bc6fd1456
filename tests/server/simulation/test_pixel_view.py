"""Directions, ranges, names and bounds at points of an image."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, EquiangularMirror, SphericalMirror
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.simulation.sight import (
    OUTSIDE,
    NamedScene,
    PixelView,
    look_through_pixel,
)
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, SphereBand, World
from helpers.mirror_checks import make_camera
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


@pytest.mark.parametrize(
    "mirror",
    [SphericalMirror(0.03, 0.2), EquiangularMirror(11.0, 0.1)],
    ids=lambda mirror: type(mirror).__name__,
)
def test_ball_next_to_a_mirror_without_a_viewpoint_is_where_it_is_drawn(
    mirror: NonCentralMirror,
) -> None:
    # 0.2 m from the viewpoint, where rays of the best viewpoint err by pixels.
    camera = make_camera(mirror, 400)
    centre = 0.2 * np.array((math.sin(1.9), 0.0, math.cos(1.9)))
    white = Material((1.0, 1.0, 1.0), unlit=True)
    ball = Item("ball", SphereBand(0.006, 0.0, math.pi, 48, 24), Pose.from_rpy(centre), white)
    world = World("ball", (ball,), background=(0.0, 0.0, 0.0))
    scene = build_scene(world)
    renderer = TraceRenderer(scene, world, threads=1)
    light = renderer.prepare(camera, make_plan(camera, samples=4)).render_linear(
        CameraState(Pose.identity())
    )[..., 1]
    renderer.close()
    drawn_px = centroid_px(light)
    things = NamedScene(scene, EmbreeRayCaster(scene), (), ())
    spec = OmniCameraSpec(camera, RenderSettings())
    left, top = (int(value) - 12 for value in drawn_px)
    names = np.zeros((48, 48))
    for row, column in np.ndindex(names.shape):
        point = (left + (column + 0.5) / 2.0, top + (row + 0.5) / 2.0)
        view = look_through_pixel(spec, Pose.identity(), point, things, None)
        names[row, column] = view.object_name == "ball"
    assert names.sum() > 25.0
    found_px = centroid_px(names) / 2.0 + (left, top)
    assert found_px == pytest.approx(drawn_px, abs=0.05)
    # The range is that along the ray: to the ball's surface from the mirror's point.
    seen, _ = pixel_from_point(camera, centre)
    origin, _, _ = ray_from_pixel(camera, seen)
    view = look_through_pixel(spec, Pose.identity(), (seen[0], seen[1]), things, None)
    assert view.range_m == pytest.approx(np.linalg.norm(centre - origin) - 0.006, abs=1e-4)


def centroid_px(image: Floats) -> Floats:
    """(2,) centroid of light, px."""
    v, u = np.indices(image.shape) + 0.5
    return np.array([(image * u).sum(), (image * v).sum()]) / image.sum()


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
