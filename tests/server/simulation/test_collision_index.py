"""Several robots: each stops at the others, and measures the others in scans."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.usarsim.commands import Drive, DriveJoints, Init, MisPkg, MultiDrive, Trace
from catoptra_protocol.usarsim.commands_drive import ControlOrder, JointCommand, LinkCommand
from catoptra_protocol.usarsim.reports import (
    GroundTruthReading,
    MissionPackageStatus,
    OdometryReading,
    RangeScanReading,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.config.robot_file import read_robots
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.joint_chain import STANDARD_PACKAGES
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.simulation.fleet import Fleet
from helpers.configs import ROBOTS
from helpers.robots import BASE, GROUND_TRUTH, SCANNER, FakeClient, make_p2at, make_walled_world

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
    """Fleet of the bundled P2AT, with noise, between walls that Embree measures."""
    world = make_walled_world(3.0)
    scene, robots = build_scene(world), read_robots(ROBOTS / "p2at.ini")[0]
    fleet = Fleet(robots, world, scene, seed=seed, ray_caster=EmbreeRayCaster(scene))
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


def test_scan_when_another_robot_is_on_the_right_is_shorter_in_its_low_half() -> None:
    fleet = make_fleet()
    one = spawn(fleet, "P2AT", 0.0)
    spawn(fleet, "Small", 0.1, 2.0)
    run(fleet, 0.2)
    scan = last_report(one, RangeScanReading)
    assert isinstance(scan, RangeScanReading)
    assert scan.ranges_m[0] == pytest.approx(1.85)
    assert set(scan.ranges_m[90:]) == {20.0}


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


def test_environment_of_a_robot_has_the_other_robots_alone() -> None:
    fleet = make_fleet()
    one, _ = spawn(fleet, "P2AT", 0.0), spawn(fleet, "Small", 2.0)
    robot = fleet.find_robot(one)
    assert robot is not None
    ((pose, size_m),) = fleet.sense(robot).robot_boxes
    assert size_m == (0.3, 0.3, 0.3)
    assert tuple(pose.translation) == (2.0, 0.0, -0.15)


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
