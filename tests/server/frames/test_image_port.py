"""Cameras on robots, and their tiles and viewports in the image port."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.commands import Drive, Init, SetCommand, SetViewports
from catoptra_protocol.usarsim.reports import CameraConfiguration, Report, VehicleStatus
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.frames.frame import IMAGE_PORT, ImagePortChannel, ViewRequest
from catoptra_server.frames.image_port import (
    CameraRobot,
    VisibleObjects,
    compose_camera_frame,
    mounted_camera_state,
)
from catoptra_server.frames.multi_view import Tile, TileLayout, multi_view_layout
from catoptra_server.frames.plan.camera import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.robot import CameraSensor, Robot
from catoptra_server.simulation.robot_description import (
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import AT_REST, Twist
from helpers.dynamic_objects import place_cube
from helpers.motion_reference import relative_twist
from helpers.robots import (
    FakeClient,
    FakeViewProvider,
    make_ground,
    make_p2at,
    make_robot_at,
    make_walled_world,
    render_channel,
)

TILE = Tile(0, 0, 8, 6)
AHEAD = PerspectiveCameraDescription("Ahead", Mount((0.1, 0.0, -0.4)), 12, 10, 1.0, 0.3, 2.0)
EGO_BODY = place_cube(0.0, 0.0, 0.0)


def make_robot() -> Robot:
    description = make_p2at(perspective_cameras=(AHEAD,))
    return make_robot_at(description, PlanarPose(1.0, 2.0, 0.5), name="R", seed=1, time_s=0.0)


def visible_objects(robot: CameraRobot) -> VisibleObjects:
    return VisibleObjects((), EGO_BODY)


def test_state_when_the_robot_is_turned_is_at_the_viewpoint() -> None:
    state = mounted_camera_state(
        Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5)), Pose.from_rpy((0.0, 0.0, -0.4543))
    )
    assert state.world_from_mirror.translation == pytest.approx((1.0, 2.0, -0.6))
    assert state.world_from_mirror.to_rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_twist_when_the_camera_is_off_the_axis_of_a_turn_has_the_lever_s_velocity() -> None:
    turn = Twist((0.2, 0.0, 0.0), (0.0, 0.0, 0.5))
    state = mounted_camera_state(Pose.identity(), Pose.from_rpy((0.4, 0.0, 0.0)), twist=turn)
    # omega x r = (0, 0, 0.5) x (0.4, 0, 0) = (0, 0.2, 0)
    assert state.twist.linear_m_s == pytest.approx((0.2, 0.2, 0.0))
    assert state.twist.angular_rad_s == (0.0, 0.0, 0.5)


def request_view(robot: Robot, camera: CameraSensor) -> ViewRequest:
    """View of a camera of its own size."""
    (view,) = compose_camera_frame(robot, camera, visible_objects).views
    assert view is not None
    return view


def test_view_when_requested_has_the_state_of_camera_and_robot() -> None:
    robot = make_robot()
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    robot.step(0.02, 0.02, make_ground().move)
    request = request_view(robot, robot.omni_cameras[0])
    state = request.camera_state
    assert request.camera == robot.omni_cameras[0].camera_spec()
    expected = robot.world_from_robot @ robot.omni_cameras[0].robot_from_camera({})
    np.testing.assert_array_equal(state.world_from_mirror.translation, expected.translation)
    assert state.noise_seed == robot.noise_seed_for(robot.omni_cameras[0].name)
    assert state.twist.linear_m_s == pytest.approx(robot.twist.linear_m_s)
    assert any(state.twist.linear_m_s)


def test_ego_body_when_the_camera_has_no_mirror_is_left_out() -> None:
    robot = make_robot()
    views = [request_view(robot, camera) for camera in robot.all_cameras]
    is_omni = [isinstance(view.camera, OmniCameraSpec) for view in views]
    assert is_omni == [True, False]
    assert [view.camera_state.ego_body is EGO_BODY for view in views] == is_omni


def test_object_that_encloses_the_viewpoint_is_left_out_but_not_the_ego_body() -> None:
    around, beside = place_cube(1.1, 0.0, -0.6), place_cube(1.3, 0.0, -0.6)
    state = mounted_camera_state(
        Pose.from_rpy((1.0, 0.0, -0.1)),
        Pose.from_rpy((0.0, 0.0, -0.5)),
        objects=(around, beside),
        ego_body=around,
    )
    assert state.objects == (beside,)
    assert state.ego_body is around


AHEAD_IMAGE_PORT_LAYOUT = PerspectiveCameraDescription(
    "Ahead", Mount((0.1, 0.0, -0.4), (0.0, 0.0, 0.0)), 12, 10, 1.0, 0.3, 2.0
)
REAR = dataclasses.replace(
    AHEAD_IMAGE_PORT_LAYOUT, name="Rear", mount=Mount((-0.1, 0.0, -0.4), (0.0, 0.0, 3.1))
)
TILES = multi_view_layout(2, 2, width_px=8, height_px=6)


def make_fleet(tiles: TileLayout | None = None, *, omni: bool = True) -> Fleet:
    robot = (
        make_p2at(perspective_cameras=(AHEAD_IMAGE_PORT_LAYOUT, REAR))
        if omni
        else make_p2at(perspective_cameras=(AHEAD_IMAGE_PORT_LAYOUT, REAR), omni_cameras=())
    )
    world = make_walled_world()
    return Fleet([robot], world, build_scene(world), seed=1, multi_view=tiles)


def spawn(fleet: Fleet, name: str = "R", x_m: float = 0.0) -> FakeClient:
    client = FakeClient()
    fleet.execute(client, Init("OmniP2AT", name, (x_m, 0.0, 0.0)), 0.0)
    return client


def viewports(config: str, *names: str | None) -> SetViewports:
    cameras = (*names, *[None] * (4 - len(names)))
    return SetViewports(config, cameras)  # type: ignore[arg-type] # four of them


def last_status(client: FakeClient) -> VehicleStatus:
    return [r for r in client.reports if isinstance(r, VehicleStatus)][-1]


def pushed_configurations(client: FakeClient) -> list[Report]:
    return [report for report in client.reports if isinstance(report, CameraConfiguration)]


def test_image_port_by_default_shows_the_omnidirectional_camera() -> None:
    fleet, views = make_fleet(), FakeViewProvider()
    spawn(fleet)
    frame = render_channel(fleet, views)
    assert (frame.rgb.shape, frame.metadata.camera) == ((6, 8, 3), "OmniCam")
    assert isinstance(views.view_requests[0].camera, OmniCameraSpec)


def test_view_when_requested_has_the_noise_seed_of_its_camera() -> None:
    fleet, views = make_fleet(), FakeViewProvider()
    client = spawn(fleet)
    render_channel(fleet, views)
    robot = fleet.find_robot(client)
    assert robot is not None
    assert views.view_requests[0].camera_state.noise_seed == robot.noise_seed_for("OmniCam")


def test_view_when_requested_has_the_ego_body_that_moves_with_the_mirror() -> None:
    effect_settings = EffectSettings((EffectSetting(SelfView(), EffectMode.AUTO),))
    plain = make_p2at(perspective_cameras=(AHEAD_IMAGE_PORT_LAYOUT,))
    assert plain.omni_camera is not None
    omni = dataclasses.replace(plain.omni_camera, effects=effect_settings)
    world = make_walled_world()
    robot = dataclasses.replace(plain, omni_cameras=(omni,))
    fleet, views = (
        Fleet([robot], world, build_scene(world), seed=1, multi_view=TILES),
        FakeViewProvider(),
    )
    client = spawn(fleet)
    fleet.execute(client, Drive(left=2.0, right=0.5), 0.0)
    fleet.step(0.02, 0.02)
    render_channel(fleet, views)
    mirror, ahead = (take.camera_state for take in views.view_requests)
    assert mirror.ego_body is not None
    assert ahead.ego_body is None, "only a mirror looks back at its robot"
    standing = fleet.find_robot(client)
    assert standing is not None
    for own, is_ in zip(
        (mirror.ego_body.world_from_object.translation, mirror.ego_body.world_from_object.rotation),
        (standing.world_from_robot.translation, standing.world_from_robot.rotation),
        strict=True,
    ):
        np.testing.assert_array_equal(own, is_)
    assert mirror.twist != AT_REST
    assert relative_twist(mirror, mirror.ego_body) == AT_REST


def test_view_without_the_effect_has_no_ego_body() -> None:
    fleet, views = make_fleet(), FakeViewProvider()
    spawn(fleet)
    render_channel(fleet, views)
    assert views.view_requests[0].camera_state.ego_body is None


def test_image_port_without_an_omni_camera_shows_the_first_camera_at_its_size() -> None:
    fleet, views = make_fleet(omni=False), FakeViewProvider()
    spawn(fleet)
    frame = render_channel(fleet, views)
    assert (frame.rgb.shape, frame.metadata.camera) == ((10, 12, 3), "Ahead")
    assert views.view_requests[0].camera == PerspectiveCameraSpec(PerspectiveCamera(12, 10, 1.0))
    assert dict(frame.metadata.camera_model or ())["Projection"] == "perspective"


def test_image_port_when_another_camera_is_set_shows_that_camera_s_view() -> None:
    fleet, views = make_fleet(), FakeViewProvider()
    client = spawn(fleet)
    fleet.execute(client, viewports("SingleView", "rear"), 0.0)
    assert render_channel(fleet, views).metadata.camera == "Rear"
    pose = views.view_requests[0].camera_state.world_from_mirror
    assert pose.to_rpy()[2] == pytest.approx(3.1)
    assert pose.translation[0] == pytest.approx(-0.1)


def test_image_port_when_divided_shows_quarters_and_black_for_a_disabled_one() -> None:
    fleet, views = make_fleet(), FakeViewProvider()
    client = spawn(fleet)
    fleet.execute(client, viewports("QuadView", "OmniCam", "Ahead", "Disable", "Rear"), 0.0)
    frame = render_channel(fleet, views)
    assert frame.rgb.shape == (6, 8, 3)
    assert [frame.rgb[y, x, 0] for y, x in ((0, 0), (0, 4), (3, 0), (3, 4))] == [1, 2, 0, 3]
    assert (frame.metadata.robot, frame.metadata.camera) == ("R", "")


def test_image_port_when_a_camera_zooms_shows_the_new_field_of_view() -> None:
    fleet, views = make_fleet(omni=False), FakeViewProvider()
    client = spawn(fleet)
    fleet.execute(client, SetCommand("Camera", "Ahead", "FOV", "0.5"), 0.0)
    render_channel(fleet, views)
    assert views.view_requests[0].camera == PerspectiveCameraSpec(PerspectiveCamera(12, 10, 0.5))


def test_tiles_when_robots_spawn_are_assigned_in_order_and_reported() -> None:
    fleet, views = make_fleet(TILES), FakeViewProvider()
    client = spawn(fleet)
    frame = render_channel(fleet, views)
    assert frame.rgb.shape == (12, 16, 3)
    corners = [frame.rgb[y, x, 0] for y, x in ((0, 0), (0, 8), (6, 0), (6, 8))]
    assert corners == [1, 2, 3, 0]
    tiles = [
        report.texture_region
        for report in pushed_configurations(client)
        if isinstance(report, CameraConfiguration)
    ]
    assert [(t.x, t.y, t.width, t.height) for t in tiles if t] == [
        (0, 0, 8, 6), (8, 0, 8, 6), (0, 6, 8, 6)
    ]  # fmt: skip
    assert last_status(client).view == 0


def test_tiles_when_there_are_no_more_leave_cameras_out() -> None:
    fleet = make_fleet(TILES)
    spawn(fleet)
    second = spawn(fleet, "S", 5.0)
    third = spawn(fleet, "T", -5.0)
    assert last_status(second).view == 3
    assert len(pushed_configurations(second)) == 1
    assert (last_status(third).view, pushed_configurations(third)) == (-1, [])


def test_tiles_when_a_robot_leaves_are_free_again() -> None:
    fleet = make_fleet(TILES)
    first = spawn(fleet)
    fleet.remove(first)
    assert not render_channel(fleet).rgb.any()
    assert last_status(spawn(fleet, "S")).view == 0


def test_tile_when_requested_alone_is_rendered_alone() -> None:
    fleet, views = make_fleet(TILES), FakeViewProvider()
    spawn(fleet)
    frame = render_channel(fleet, views, ImagePortChannel(1))
    assert (frame.rgb.shape, frame.metadata.camera) == ((6, 8, 3), "Ahead")
    assert len(views.view_requests) == 1


def test_tile_without_a_camera_is_black() -> None:
    assert not render_channel(make_fleet(TILES), channel=ImagePortChannel(3)).rgb.any()


def test_frame_of_several_robots_has_empty_metadata() -> None:
    fleet = make_fleet(TILES)
    spawn(fleet)
    spawn(fleet, "S", 5.0)
    assert render_channel(fleet, channel=IMAGE_PORT).metadata.robot == ""
