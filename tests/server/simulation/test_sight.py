"""Landmarks in view, and the thing at a point of an image, against exact geometry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, EquiangularMirror, SphericalMirror
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    camera_with_inscribed_rim,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.simulation.sensors import (
    EMPTY_ENVIRONMENT,
    EmptyScene,
    SensorEnvironment,
)
from catoptra_server.simulation.sight import (
    OUTSIDE,
    LandmarkVisibility,
    NamedScene,
    PixelView,
    compute_landmark_visibility,
    look_through_pixel,
)
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState, OrientedBox
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, SphereBand, World
from helpers.mirror_checks import make_camera
from helpers.room_ray_caster import make_room_world, oriented_box_at
from helpers.worlds import make_plan

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
    world = World("field", (), landmarks=(landmark,), landmark_albedos=GREY)
    return SensorEnvironment(commit_to_reference(build_scene(world)))


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


SCENE = build_scene(make_room_world())
# The optical axis down: the frame of an upright robot's mirror.
POSE = Pose.from_rpy((0.5, 0.0, 0.0))


def look(
    camera: CameraSpec, point_px: tuple[float, float], robots: dict[str, OrientedBox] | None = None
) -> PixelView:
    boxes = robots or {}
    things = NamedScene(SCENE, commit_to_reference(SCENE), tuple(boxes), tuple(boxes.values()))
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
    things = NamedScene(scene, commit_to_reference(scene), (), ())
    spec = OmniCameraSpec(camera, RenderSettings())
    left, top = (int(value) - 6 for value in drawn_px)
    names = np.zeros((24, 24))
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
def test_pixel_outside_the_mirror_or_the_image_shows_nothing(point_px: tuple[float, float]) -> None:
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
    things = NamedScene(SCENE, commit_to_reference(SCENE), (), ())
    at_centre = look_through_pixel(OMNI, POSE, (100.0, 101.0), things, bound)
    at_rim = look_through_pixel(OMNI, POSE, (100.0, 1.0), things, bound)
    assert at_centre.bound_px is not None
    assert at_rim.bound_px is not None
    assert at_centre.bound_px < at_rim.bound_px <= bound.outline_error_px
