"""What the screen shows: viewports of one robot, or a tile for each camera of all robots."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.wire.commands import Drive, Init, Set, SetViewports
from catoptra_protocol.wire.reports import CameraConfiguration, Report, VehicleStatus
from catoptra_server.effects.effect import EffectWishes, Mode, Wish
from catoptra_server.effects.own_body import OwnBody
from catoptra_server.imaging.multi_view import TileLayout, multi_view
from catoptra_server.imaging.shot import SCREEN, OmniEye, ScreenChannel
from catoptra_server.robot.description import CameraDescription, Mount
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.motion import AT_REST
from catoptra_server.simulation import Fleet
from helpers.motion import seen_motion
from helpers.robots import FakeClient, FakeViews, p2at, shown, walled_world

AHEAD = CameraDescription("Ahead", Mount((0.1, 0.0, -0.4), (0.0, 0.0, 0.0)), 12, 10, 1.0, 0.3, 2.0)
REAR = dataclasses.replace(AHEAD, name="Rear", mount=Mount((-0.1, 0.0, -0.4), (0.0, 0.0, 3.1)))
TILES = multi_view(2, 2, width_px=8, height_px=6)


def fleet_of(tiles: TileLayout | None = None, *, omni: bool = True) -> Fleet:
    robot = p2at(cameras=(AHEAD, REAR)) if omni else p2at(cameras=(AHEAD, REAR), omni_camera=None)
    world = walled_world()
    return Fleet([robot], world, build_scene(world), seed=1, multi_view=tiles)


def spawned(fleet: Fleet, name: str = "R", x_m: float = 0.0) -> FakeClient:
    client = FakeClient()
    fleet.obey(client, Init("OmniP2AT", name, (x_m, 0.0, 0.0)), 0.0)
    return client


def viewports(config: str, *names: str | None) -> SetViewports:
    cameras = (*names, *[None] * (4 - len(names)))
    return SetViewports(config, cameras)  # type: ignore[arg-type] # four of them


def status_of(client: FakeClient) -> VehicleStatus:
    return [r for r in client.reports if isinstance(r, VehicleStatus)][-1]


def pushed(client: FakeClient) -> list[Report]:
    return [report for report in client.reports if isinstance(report, CameraConfiguration)]


def test_screen_when_nothing_was_set_shows_the_omnidirectional_camera() -> None:
    fleet, views = fleet_of(), FakeViews()
    spawned(fleet)
    frame = shown(fleet, views)
    assert (frame.rgb.shape, frame.caption.camera) == ((6, 8, 3), "OmniCam")
    assert isinstance(views.takes[0].eye, OmniEye)


def test_take_when_exposed_has_the_noise_key_of_its_robots_camera() -> None:
    fleet, views = fleet_of(), FakeViews()
    client = spawned(fleet)
    shown(fleet, views)
    robot = fleet.robot_of(client)
    assert robot is not None
    assert views.takes[0].exposure.key == robot.frame_key("OmniCam")


def test_take_when_exposed_has_the_own_body_that_moves_as_the_mirror_does() -> None:
    wishes = EffectWishes((Wish(OwnBody(), Mode.AUTO),))
    plain = p2at(cameras=(AHEAD,))
    assert plain.omni_camera is not None
    omni = dataclasses.replace(plain.omni_camera, effects=wishes)
    world = walled_world()
    robot = dataclasses.replace(plain, omni_camera=omni)
    fleet, views = Fleet([robot], world, build_scene(world), seed=1, multi_view=TILES), FakeViews()
    client = spawned(fleet)
    fleet.obey(client, Drive(left=2.0, right=0.5), 0.0)
    fleet.move(0.02, 0.02)
    shown(fleet, views)
    mirror, ahead = (take.exposure for take in views.takes)
    assert mirror.own_body is not None
    assert ahead.own_body is None, "only a mirror looks back at its robot"
    standing = fleet.robot_of(client)
    assert standing is not None
    for own, is_ in zip(
        (mirror.own_body.world_from_body.translation, mirror.own_body.world_from_body.rotation),
        (standing.world_from_robot.translation, standing.world_from_robot.rotation),
        strict=True,
    ):
        np.testing.assert_array_equal(own, is_)
    assert mirror.twist != AT_REST
    assert seen_motion(mirror, mirror.own_body) == AT_REST


def test_take_when_no_effect_asks_for_it_has_no_own_body() -> None:
    fleet, views = fleet_of(), FakeViews()
    spawned(fleet)
    shown(fleet, views)
    assert views.takes[0].exposure.own_body is None


def test_screen_when_the_robot_has_ordinary_cameras_alone_shows_the_first_at_its_size() -> None:
    fleet, views = fleet_of(omni=False), FakeViews()
    spawned(fleet)
    frame = shown(fleet, views)
    assert (frame.rgb.shape, frame.caption.camera) == ((10, 12, 3), "Ahead")
    assert views.takes[0].eye == PerspectiveCamera(12, 10, 1.0)
    assert dict(frame.caption.law or ())["Projection"] == "perspective"


def test_screen_when_another_camera_is_set_shows_that_from_where_it_looks() -> None:
    fleet, views = fleet_of(), FakeViews()
    client = spawned(fleet)
    fleet.obey(client, viewports("SingleView", "rear"), 0.0)
    assert shown(fleet, views).caption.camera == "Rear"
    pose = views.takes[0].exposure.world_from_mirror
    assert pose.rpy()[2] == pytest.approx(3.1)
    assert pose.translation[0] == pytest.approx(-0.1)


def test_screen_when_divided_shows_quarters_and_black_where_one_is_disabled() -> None:
    fleet, views = fleet_of(), FakeViews()
    client = spawned(fleet)
    fleet.obey(client, viewports("QuadView", "OmniCam", "Ahead", "Disable", "Rear"), 0.0)
    frame = shown(fleet, views)
    assert frame.rgb.shape == (6, 8, 3)
    assert [frame.rgb[y, x, 0] for y, x in ((0, 0), (0, 4), (3, 0), (3, 4))] == [1, 2, 0, 3]
    assert (frame.caption.robot, frame.caption.camera) == ("R", "")


def test_screen_when_a_camera_zooms_shows_its_new_field_of_view() -> None:
    fleet, views = fleet_of(omni=False), FakeViews()
    client = spawned(fleet)
    fleet.obey(client, Set("Camera", "Ahead", "FOV", "0.5"), 0.0)
    shown(fleet, views)
    assert views.takes[0].eye == PerspectiveCamera(12, 10, 0.5)


def test_tiles_when_robots_come_are_given_in_order_and_told() -> None:
    fleet, views = fleet_of(TILES), FakeViews()
    client = spawned(fleet)
    frame = shown(fleet, views)
    assert frame.rgb.shape == (12, 16, 3)
    corners = [frame.rgb[y, x, 0] for y, x in ((0, 0), (0, 8), (6, 0), (6, 8))]
    assert corners == [1, 2, 3, 0]
    tiles = [report.tile for report in pushed(client) if isinstance(report, CameraConfiguration)]
    assert [(t.x, t.y, t.width, t.height) for t in tiles if t] == [
        (0, 0, 8, 6), (8, 0, 8, 6), (0, 6, 8, 6)
    ]  # fmt: skip
    assert status_of(client).view == 0


def test_tiles_when_there_are_no_more_leave_cameras_out() -> None:
    fleet = fleet_of(TILES)
    spawned(fleet)
    second = spawned(fleet, "S", 5.0)
    third = spawned(fleet, "T", -5.0)
    assert status_of(second).view == 3
    assert len(pushed(second)) == 1
    assert (status_of(third).view, pushed(third)) == (-1, [])


def test_tiles_when_a_robot_leaves_are_free_again() -> None:
    fleet = fleet_of(TILES)
    first = spawned(fleet)
    fleet.remove(first)
    assert not shown(fleet).rgb.any()
    assert status_of(spawned(fleet, "S")).view == 0


def test_tile_when_asked_for_alone_is_drawn_alone() -> None:
    fleet, views = fleet_of(TILES), FakeViews()
    spawned(fleet)
    frame = shown(fleet, views, ScreenChannel(1))
    assert (frame.rgb.shape, frame.caption.camera) == ((6, 8, 3), "Ahead")
    assert len(views.takes) == 1


def test_tile_when_nobody_s_is_black() -> None:
    assert not shown(fleet_of(TILES), channel=ScreenChannel(3)).rgb.any()


def test_screen_when_several_robots_are_on_it_is_nobody_s_in_particular() -> None:
    fleet = fleet_of(TILES)
    spawned(fleet)
    spawned(fleet, "S", 5.0)
    assert shown(fleet, channel=SCREEN).caption.robot == ""
