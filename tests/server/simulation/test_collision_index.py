"""Several robots: each stops at the others, and measures the others in scans."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.commands import (
    ControlOrder,
    Drive,
    DriveJoints,
    Init,
    JointCommand,
    LinkCommand,
    MisPkg,
    MultiDrive,
    Trace,
)
from catoptra_protocol.usarsim.reports import (
    GroundTruthReading,
    MissionPackageStatus,
    OdometryReading,
    RangeScanReading,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.ray_caster import commit_ray_caster, commit_to_reference
from catoptra_server.simulation import spawning
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.robot_description import STANDARD_PACKAGES, PlanarPose
from catoptra_server.simulation.sensors import EmptyScene
from catoptra_server.world.scene_mesh import build_scene
from helpers.configs import ROBOTS
from helpers.robots import BASE, GROUND_TRUTH, SCANNER, FakeClient, make_p2at, make_walled_world

WAIT_S = 20.0
SMALL = dataclasses.replace(BASE, dimensions_m=(0.3, 0.3, 0.3))
CLASSES = (
    make_p2at(
        class_name="USARBot.P2AT",
        sensors=(SCANNER, GROUND_TRUTH),
        mission_packages=(STANDARD_PACKAGES["camerapantilt"],),
    ),
    make_p2at(class_name="USARBot.Small", base=SMALL, sensors=(GROUND_TRUTH,)),
)


def make_fleet() -> Fleet:
    world = make_walled_world()
    return Fleet(CLASSES, world, build_scene(world), seed=1)


def spawn(fleet: Fleet, class_: str, x_m: float, y_m: float = 0.0) -> FakeClient:
    client = FakeClient()
    fleet.execute(client, Init(class_, location_m=(x_m, y_m, 0.0)), 0.0)
    return client


def run(fleet: Fleet, seconds: float) -> None:
    for tick in range(1, round(seconds / 0.02) + 1):
        fleet.step(0.02, tick * 0.02)
        fleet.deliver_due_reports(tick * 0.02)


def last_report(client: FakeClient, kind: type) -> object:
    return [report for report in client.reports if isinstance(report, kind)][-1]


def true_x_m(client: FakeClient) -> float:
    truth = last_report(client, GroundTruthReading)
    assert isinstance(truth, GroundTruthReading)
    return truth.location_m[0]


def drive_bundled_p2at(seed: int = 1) -> tuple[Fleet, FakeClient]:
    """Fleet of the bundled P2AT, with noise, between walls that rays measure."""
    world = make_walled_world(3.0)
    scene, robots = build_scene(world), read_robots(ROBOTS / "p2at.ini")[0]
    fleet = Fleet(robots, world, scene, seed=seed, ray_caster=commit_to_reference(scene))
    client = spawn(fleet, "P2AT", 0.0)
    fleet.execute(client, Drive(2.0, 2.0), 0.0)
    run(fleet, 2.0)
    return fleet, client


def test_bundled_p2at_driven_for_2_s_moves_0_52_m_by_truth_and_odometry() -> None:
    _, client = drive_bundled_p2at()
    odometry = last_report(client, OdometryReading)
    assert isinstance(odometry, OdometryReading)
    assert true_x_m(client) == pytest.approx(0.52, abs=1e-9)
    # Five sigma of DistanceNoise=0.005 after 0.52 m.
    assert odometry.x_m == pytest.approx(0.52, abs=5 * 0.005 * 0.52**0.5)


def test_bundled_p2at_when_run_again_reports_the_same_bytes() -> None:
    one, again, other = (
        b"".join(line_from_report(report) for report in drive_bundled_p2at(seed)[1].reports)
        for seed in (1, 1, 2)
    )
    assert one == again != other


def test_bundled_p2at_when_at_a_cycle_reports_in_the_order_of_ut2004() -> None:
    _, client = drive_bundled_p2at()
    types = [line_from_report(report).split(b"{Type ")[-1].split(b"}")[0] for report in
             client.batches[0]]  # fmt: skip
    assert types[:5] == [b"Sonar", b"RangeScanner", b"INS", b"Odometry", b"Encoder"]
    assert types[-4:-2] == [b"GroundTruth", b"GPS"]
    assert isinstance(client.batches[0][-2], MissionPackageStatus)
    assert isinstance(client.batches[0][-1], VehicleStatus)


def test_robot_when_another_blocks_the_way_stops_in_contact() -> None:
    fleet = make_fleet()
    one, other = spawn(fleet, "P2AT", 0.0), spawn(fleet, "Small", 2.0)
    fleet.execute(one, Drive(5.0, 5.0), 0.0)
    run(fleet, 4.0)
    nose = true_x_m(one) + 0.5 * 0.5238
    assert 2.0 - 0.15 - 1e-3 < nose <= 2.0 - 0.15
    assert true_x_m(other) == 2.0


def test_robot_when_the_other_is_removed_continues() -> None:
    fleet = make_fleet()
    one, other = spawn(fleet, "P2AT", 0.0), spawn(fleet, "Small", 0.5)
    fleet.execute(one, Drive(5.0, 5.0), 0.0)
    fleet.remove(other)
    run(fleet, 2.0)
    assert true_x_m(one) == pytest.approx(1.3)


def test_scan_when_the_other_moved_has_its_new_position() -> None:
    fleet = make_fleet()
    one, other = spawn(fleet, "P2AT", 0.0), spawn(fleet, "Small", 2.0)
    fleet.execute(other, Drive(5.0, 5.0), 0.0)
    run(fleet, 2.0)
    scan = last_report(one, RangeScanReading)
    assert isinstance(scan, RangeScanReading)
    # The scanner is 0.1 m ahead of the centre; the other's rear is 0.15 m behind its own.
    assert scan.ranges_m[90] == pytest.approx(true_x_m(other) - 0.15 - 0.1)


def test_joints_when_driven_in_one_line_all_move() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "P2AT", 0.0)
    joints = (JointCommand("CameraPan", 0.1), JointCommand("CameraTilt", -0.1, ControlOrder.SPEED))
    fleet.execute(client, DriveJoints(joints), 0.0)
    run(fleet, 1.0)
    status = last_report(client, MissionPackageStatus)
    assert isinstance(status, MissionPackageStatus)
    assert [link.value for link in status.links] == pytest.approx([0.1, -0.1])


def test_package_when_commanded_by_either_command_moves() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "P2AT", 0.0)
    fleet.execute(client, MisPkg("camerapantilt", (LinkCommand(1, 0.1), LinkCommand(9, 1.0))), 0.0)
    fleet.execute(client, MultiDrive((("CameraTilt", -0.05), ("FRFlipper", 1.5))), 0.0)
    fleet.execute(client, Trace(enabled=True), 0.0)
    run(fleet, 1.0)
    status = last_report(client, MissionPackageStatus)
    assert isinstance(status, MissionPackageStatus)
    assert [link.value for link in status.links] == pytest.approx([0.1, -0.05])


def assert_apart(fleet: Fleet, clients: list[FakeClient]) -> None:
    """Assert that no two robots touch, nor a robot the scene."""
    robots = [robot for client in clients if (robot := fleet.find_robot(client))]
    assert len(robots) == len(clients)
    index = CollisionIndex(build_scene(make_walled_world()), EmptyScene())
    for robot in robots:
        others = [other for other in robots if other is not robot]
        pose = robot.world_from_robot
        yaw_rad = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
        x_m, y_m = pose.translation[:2].tolist()
        # Raises where it touches something.
        index.place(robot.description, PlanarPose(x_m, y_m, yaw_rad), robots=others)


def test_sixteen_robots_at_one_location_stand_apart_and_drive_off() -> None:
    fleet = make_fleet()
    clients = [spawn(fleet, "P2AT", 0.0) for _ in range(16)]
    assert_apart(fleet, clients)
    assert clients[0].spawns == [("P2AT", None)]
    moved = [location for client in clients[1:] for _, location in client.spawns]
    assert all(location and math.hypot(*location[:2]) <= 2.0 for location in moved)
    for client in clients:
        fleet.execute(client, Drive(1.0, 0.8), 0.0)
    before = [true_x_m(client) for client in clients if not run(fleet, 0.0)]
    run(fleet, 0.6)
    assert_apart(fleet, clients)
    assert max(true_x_m(client) for client in clients) > max(before) + 0.05


@pytest.mark.parametrize("class_", ["P2AT", "Small"])
def test_robot_when_spawned_into_a_wall_is_moved_out_of_it(class_: str) -> None:
    fleet = make_fleet()
    client = spawn(fleet, class_, 50.0)
    assert_apart(fleet, [client])
    ((_, location),) = client.spawns
    assert location is not None
    robot = fleet.find_robot(client)
    assert robot is not None
    assert location == pytest.approx(tuple(robot.world_from_robot.translation))
    fleet.execute(client, Drive(-5.0, -5.0), 0.0)
    run(fleet, 1.0)
    assert true_x_m(client) == pytest.approx(location[0] - 0.65, abs=1e-6)


def test_newcomer_among_sixty_two_robots_finds_a_place() -> None:
    fleet = make_fleet()
    clients = [spawn(fleet, "P2AT", 0.5 * (n % 8) - 2.0, 0.5 * (n // 8) - 2.0) for n in range(62)]
    newcomer = spawn(fleet, "P2AT", 0.0)
    assert newcomer.spawns
    assert not any(client.rejections for client in clients)


def test_robot_without_a_free_place_is_refused_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    offsets_m = spawning._search_offsets_m()[:1000]
    monkeypatch.setattr(spawning, "_search_offsets_m", lambda: offsets_m)
    fleet = make_fleet()
    clients = [spawn(fleet, "P2AT", 0.0) for _ in range(60)]
    refused = [client for client in clients if client.rejections]
    assert len(refused) > 10
    assert refused[0].rejections == [
        "there is no free place within 8 m of 0,0, where the robot touches an obstacle"
    ]
    assert not refused[0].spawns
    assert not refused[0].reports
    assert fleet.find_robot(refused[0]) is None
    assert_apart(fleet, [client for client in clients if client.spawns])


@pytest.mark.parametrize("x_m", [1e5, -1e5])
def test_robot_at_the_limit_drives_and_measures(x_m: float) -> None:
    fleet = make_fleet()
    client = spawn(fleet, "P2AT", x_m, -x_m)
    fleet.execute(client, Drive(5.0, 5.0), 0.0)
    run(fleet, 0.2)
    assert true_x_m(client) == pytest.approx(x_m + 0.13)


WORLD_FILES = sorted((ROBOTS.parent / "worlds").glob("*.ini"))


@pytest.mark.parametrize("file", WORLD_FILES, ids=lambda file: file.stem)
def test_start_poses_of_bundled_worlds_are_free_for_all_bundled_robots(file: Path) -> None:
    world = read_world(file)[0]
    robots = [robot for each in sorted(ROBOTS.glob("*.ini")) for robot in read_robots(each)[0]]
    scene = build_scene(world)
    index = CollisionIndex(scene, commit_ray_caster(scene))
    for start in world.starts:
        (x_m, y_m, z_m), yaw_rad = start.location_m, start.rotation_rad[2]
        for robot in robots:
            body = index.place(robot, PlanarPose(x_m, y_m, yaw_rad), z_m)
            assert (body.pose.x_m, body.pose.y_m) == (x_m, y_m), start.name


# Places in INIT lines of old clients: UvA's, MATLAB's, Player's and ROS's.
LEGACY_LOCATIONS = [(4.5, 1.9), (0.4, -0.4), (0.5, 0.5), (1.5, 1.0), (0.0, 0.0), (2.2, 1.8)]


@pytest.mark.parametrize("file", WORLD_FILES, ids=lambda file: file.stem)
def test_init_lines_of_old_clients_spawn_in_every_bundled_world(file: Path) -> None:
    world = read_world(file)[0]
    classes, scene = read_robots(ROBOTS / "p2at.ini")[0], build_scene(world)
    for x_m, y_m in LEGACY_LOCATIONS:
        fleet = Fleet(classes, world, scene, seed=1)
        client = spawn(fleet, "P2AT", x_m, y_m)
        assert not client.rejections
        assert client.reports


def make_fleet_with_tripod() -> Fleet:
    tripod = dataclasses.replace(read_robots(ROBOTS / "tripod.ini")[0][0], sensors=(GROUND_TRUTH,))
    world = make_walled_world(0.05)
    return Fleet((*CLASSES, tripod), world, build_scene(world), seed=1)


def test_tripod_stands_where_it_is_put_and_stays_there() -> None:
    fleet, client = make_fleet_with_tripod(), FakeClient()
    # In the air, 5 cm from a wall that a base would touch.
    fleet.execute(client, Init("Tripod", location_m=(0.0, 0.0, -0.3)), 0.0)
    assert client.spawns == [("Tripod", None)]
    fleet.execute(client, Drive(5.0, 5.0, flip=True), 0.0)
    run(fleet, 1.0)
    truth = last_report(client, GroundTruthReading)
    assert isinstance(truth, GroundTruthReading)
    assert truth.location_m == (0.0, 0.0, -0.3)


def test_tripod_is_neither_met_nor_measured_by_robots() -> None:
    fleet, camera = make_fleet_with_tripod(), FakeClient()
    fleet.execute(camera, Init("Tripod", location_m=(-3.0, 0.0, 0.0)), 0.0)
    robot = spawn(fleet, "P2AT", -3.5)
    fleet.execute(robot, Drive(5.0, 5.0), 0.0)
    run(fleet, 1.0)
    assert true_x_m(robot) > -3.0
    scan = last_report(robot, RangeScanReading)
    assert isinstance(scan, RangeScanReading)
    alone = make_fleet_with_tripod()
    other = spawn(alone, "P2AT", -3.5)
    alone.execute(other, Drive(5.0, 5.0), 0.0)
    run(alone, 1.0)
    assert scan == last_report(other, RangeScanReading)
