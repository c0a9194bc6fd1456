"""All robots of a world: spawning, rejection, commands, frames."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.commands import Command, Drive, GetConf, GetGeo, GetStartPoses, Init
from catoptra_protocol.usarsim.reports import (
    CameraConfiguration,
    Configuration,
    Geometry,
    GroundTruthReading,
    OdometryReading,
    StartPoses,
    VehicleConfiguration,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.frames.frame import IMAGE_PORT
from catoptra_server.simulation.events import AccuracyTargetChanged
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import EmptyScene, Triangles
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import (
    CAMERA,
    SCANNER,
    SONAR,
    FakeClient,
    FakeViewProvider,
    make_p2at,
    make_walled_world,
    render_channel,
)

INIT = Init("USARBot.OmniP2AT", name="R", location_m=(0.0, 0.0, 0.0))


def make_fleet(description: RobotDescription | None = None, *, wall_m: float = 50) -> Fleet:
    world = make_walled_world(wall_m)
    described = description or make_p2at()
    return Fleet([described], world, build_scene(world), seed=1)


def spawn(fleet: Fleet, init: Init = INIT) -> FakeClient:
    client = FakeClient()
    fleet.execute(client, init, 0.0)
    return client


def read_ground_truth(client: FakeClient) -> GroundTruthReading:
    return [report for report in client.reports if isinstance(report, GroundTruthReading)][-1]


def execute(fleet: Fleet, client: FakeClient, command: Command) -> list[object]:
    before = len(client.reports)
    fleet.execute(client, command, 0.0)
    return list(client.reports[before:])


def test_init_when_accepted_has_a_whole_cycle_as_reply() -> None:
    client = spawn(make_fleet())
    assert [type(r) for r in client.batches[0]] == [
        OdometryReading,
        GroundTruthReading,
        VehicleStatus,
    ]


@pytest.mark.parametrize(
    "init",
    [
        Init("USARBot.P2DX", location_m=(0.0, 0.0, 0.0)),
        Init("", location_m=(0.0, 0.0, 0.0)),
        Init("OmniP2AT"),
        Init("OmniP2AT", start="Nowhere"),
    ],
)
def test_init_when_class_or_start_is_unknown_is_rejected_without_a_reply(init: Init) -> None:
    fleet = make_fleet()
    client = spawn(fleet, init)
    assert (len(client.rejections), client.reports) == (1, [])
    assert fleet.find_robot(client) is None


def test_init_when_rejected_may_be_repeated() -> None:
    fleet = make_fleet()
    client = spawn(fleet, Init("Wrong"))
    fleet.execute(client, INIT, 0.0)
    assert fleet.find_robot(client) is not None


def test_init_at_a_location_ignores_height_and_tilt() -> None:
    init = dataclasses.replace(INIT, location_m=(1.0, 2.0, -9.0), rotation_rad=(0.3, 0.2, 7.0))
    truth = read_ground_truth(spawn(make_fleet(), init))
    assert truth.location_m == pytest.approx((1.0, 2.0, -0.1457))
    assert truth.rotation_rad == pytest.approx((0.0, 0.0, 7.0 - 2.0 * np.pi))


def test_init_with_location_and_start_uses_the_location() -> None:
    truth = read_ground_truth(spawn(make_fleet(), dataclasses.replace(INIT, start="Aside")))
    assert truth.location_m[:2] == (0.0, 0.0)


def test_names_in_use_get_a_number_and_are_free_after_removal() -> None:
    fleet = make_fleet()
    clients = [spawn(fleet) for _ in range(3)]
    assert [fleet.find_robot(c).name for c in clients] == ["R", "R2", "R3"]  # type: ignore[union-attr] # each has one
    fleet.remove(clients[1])
    assert fleet.find_robot(spawn(fleet)).name == "R2"  # type: ignore[union-attr] # it has one


def test_remove_when_there_is_no_robot_does_nothing() -> None:
    make_fleet().remove(FakeClient())


@pytest.mark.parametrize("command", [Drive(1.0, 1.0), GetConf("Robot"), GetGeo("Robot")])
def test_command_when_there_is_no_robot_is_ignored(command: Command) -> None:
    assert execute(make_fleet(), FakeClient(), command) == []


def test_start_poses_without_a_robot_are_reported() -> None:
    (poses,) = execute(make_fleet(), FakeClient(), GetStartPoses())
    assert isinstance(poses, StartPoses)
    assert [pose.name for pose in poses.poses] == ["Centre", "Aside"]


@pytest.mark.parametrize("name", [None, "whatever"])
def test_getconf_when_of_the_robot_ignores_the_name(name: str | None) -> None:
    fleet = make_fleet()
    (configuration,) = execute(fleet, spawn(fleet), GetConf("Robot", name))
    assert isinstance(configuration, VehicleConfiguration)
    assert configuration.name == "OmniP2AT"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (GetConf("Sonar"), Configuration("Sonar")),
        (GetConf("Sonar", "F1"), Configuration("Sonar", (("Name", "F1"),))),
        (GetConf("Odometry", "Other"), Configuration("Odometry", (("Name", "Other"),))),
        (GetGeo("Sonar"), Geometry("Sonar", ())),
        (GetGeo("Sonar", "F1"), Geometry("Sonar", (), name="F1")),
        (GetConf(""), Configuration("")),
        (GetGeo(""), Geometry("", ())),
    ],
)
def test_question_when_nothing_matches_has_the_empty_form(
    command: Command, expected: Configuration | Geometry
) -> None:
    fleet = make_fleet()
    assert execute(fleet, spawn(fleet), command) == [expected]
    assert line_from_report(expected).endswith(b"}\r\n")


def test_getconf_of_the_camera_has_its_camera_model() -> None:
    fleet = make_fleet()
    (configuration,) = execute(fleet, spawn(fleet), GetConf("camera", "OMNICAM"))
    assert isinstance(configuration, CameraConfiguration)
    camera, height_m = omni_camera_from_pairs(configuration.extra_pairs)
    assert camera.mirror == CAMERA.camera.mirror
    assert height_m == pytest.approx(0.6, abs=1e-12)


def test_getgeo_when_of_a_sensor_lists_it() -> None:
    fleet = make_fleet()
    (geometry,) = execute(fleet, spawn(fleet), GetGeo("odometry", "ODOMETRY"))
    assert isinstance(geometry, Geometry)
    assert [item.name for item in geometry.items] == ["Odometry"]


def test_drive_when_there_are_two_robots_moves_only_one() -> None:
    fleet = make_fleet()
    one, other = spawn(fleet), spawn(fleet)
    before = read_ground_truth(other).location_m
    fleet.execute(one, Drive(2.0, 2.0), 0.0)
    for tick in range(1, 11):
        fleet.step(0.02, tick * 0.02)
        fleet.deliver_due_reports(tick * 0.02)
    assert read_ground_truth(one).location_m[0] == pytest.approx(0.052)
    assert read_ground_truth(other).location_m == before


def test_report_due_when_nothing_is_due_delivers_nothing() -> None:
    fleet = make_fleet()
    client = spawn(fleet)
    fleet.deliver_due_reports(0.1)
    assert len(client.batches) == 1


class CountingRayCaster:
    """An empty scene that counts queries."""

    def __init__(self) -> None:
        self.num_queries = 0

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        self.num_queries += 1
        return EmptyScene().distances(origins, directions)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        self.num_queries += 1
        return EmptyScene().closest_hits(origins, directions)

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        self.num_queries += 1
        return EmptyScene().closest_triangles(origins, directions)


def test_sensors_when_none_is_due_cast_no_rays() -> None:
    world, rays = make_walled_world(), CountingRayCaster()
    slow = dataclasses.replace(SCANNER, interval_s=0.4)
    described = make_p2at(sensors=(slow, dataclasses.replace(SONAR, interval_s=0.2)))
    fleet = Fleet([described], world, build_scene(world), seed=1, ray_caster=rays)
    queries = []
    for tick in range(1, 6):
        fleet.step(0.02, tick * 0.02)
        fleet.deliver_due_reports(tick * 0.02)
    queries.append(rays.num_queries)
    spawn(fleet)
    for tick in range(1, 41):
        fleet.step(0.02, tick * 0.02)
        fleet.deliver_due_reports(tick * 0.02)
        if tick % 10 == 5:
            queries.append(rays.num_queries)
    assert queries[0] == 0
    # After the spawn the sonar every 10 ticks, the scanner every 20; nothing for standing.
    assert [count - queries[1] for count in queries[2:]] == [1, 3, 4]


def test_frame_of_the_image_port_is_of_the_first_robot() -> None:
    views, fleet = FakeViewProvider(), make_fleet()
    spawn(fleet, dataclasses.replace(INIT, location_m=(1.0, 2.0, 0.0)))
    spawn(fleet)
    is_ = render_channel(fleet, views).metadata
    assert (is_.camera, is_.robot) == ("OmniCam", "R")
    assert is_.world_from_robot.translation[:2].tolist() == [1.0, 2.0]
    viewpoint = views.view_requests[0].camera_state.world_from_mirror.translation
    assert viewpoint == pytest.approx((1.0, 2.0, -0.6))


def test_frame_of_a_robot_without_a_camera_is_black() -> None:
    fleet = make_fleet(make_p2at(omni_cameras=()))
    client = spawn(fleet)
    frame = render_channel(fleet)
    assert (frame.metadata.camera, frame.rgb.any()) == ("", False)
    assert execute(fleet, client, GetConf("Camera")) == [Configuration("Camera")]


@pytest.mark.parametrize(("camera", "is_found"), [("", True), ("OMNICAM", True), ("Other", False)])
def test_accuracy_target_when_the_camera_is_named_in_any_case_is_set(
    camera: str, is_found: bool
) -> None:
    fleet, client = make_fleet(), FakeClient()
    event = AccuracyTargetChanged(client, camera, 2.5, None, lambda *reply: None)
    assert fleet.set_accuracy_target(event) == (None, camera)
    fleet.execute(client, INIT, 0.0)
    view, _ = fleet.set_accuracy_target(event)
    assert (view is not None) is is_found
    if view is not None:
        assert view.camera.render_settings.accuracy_target.max_error_px == 2.5  # type: ignore[union-attr] # a mirror
        (frame_view,) = fleet.cameras.compose_frame(IMAGE_PORT).views
        assert frame_view is not None
        assert view.camera == frame_view.camera
        place_m = view.camera_state.world_from_mirror.translation
        assert (place_m == frame_view.camera_state.world_from_mirror.translation).all()
