"""One robot: commands, reports and their times; the state of a fleet for viewers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_NOTES
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.commands import (
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    Init,
    JointCommand,
    LinkCommand,
    MisPkg,
    Note,
    ShareControl,
)
from catoptra_protocol.usarsim.reports import (
    EncoderReadings,
    GroundTruthReading,
    MissionPackageStatus,
    OdometryReading,
    VehicleConfiguration,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.commands import execute_get_conf, execute_get_geo
from catoptra_server.simulation.drive import RobotBody, WheelTravel
from catoptra_server.simulation.events import RejectedError
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.robot import CommandLog, Robot
from catoptra_server.simulation.robot_description import (
    CHASSIS_PARENT,
    STANDARD_PACKAGES,
    LinkDescription,
    MissionPackageDescription,
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import AT_REST
from helpers.robots import (
    ENCODER,
    GROUND_TRUTH,
    ODOMETRY,
    FakeClient,
    make_ground,
    make_p2at,
    make_robot_at,
    make_walled_world,
)

LEVEL = make_ground().move
TICK_S = 0.02


def spawn(description: RobotDescription | None = None, *, time_s: float = 0.0) -> Robot:
    pose = PlanarPose(0.0, 0.0, 0.0)
    return make_robot_at(
        description or make_p2at(),
        pose,
        name="R",
        seed=1,
        time_s=time_s,
    )


def step(robot: Robot, ticks: int, *, since: int = 0) -> None:
    for tick in range(since + 1, since + ticks + 1):
        robot.step(TICK_S, tick * TICK_S, LEVEL)


def position(robot: Robot) -> tuple[float, float]:
    x, y, _ = robot.world_from_robot.translation
    return float(x), float(y)


def test_drive_when_left_is_faster_turns_clockwise() -> None:
    robot = spawn()
    robot.drive_wheels(Drive(1.0, -1.0), 0.0)
    step(robot, 50)
    yaw = robot.world_from_robot.to_rpy()[2]
    assert yaw == pytest.approx(2 * 0.13 / 0.4712, abs=1e-12)
    assert position(robot) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_drive_when_one_side_is_named_keeps_the_other() -> None:
    robot = spawn()
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    robot.drive_wheels(Drive(left=1.0), 0.0)
    step(robot, 1)
    yaw = robot.world_from_robot.to_rpy()[2]
    assert yaw == pytest.approx(-1.0 * 0.13 * TICK_S / 0.4712, rel=1e-9)


@pytest.mark.parametrize(
    ("command", "speed_rad_s"),
    [
        (Drive(100.0, 100.0), 5.385),
        (Drive(-100.0, -100.0), -5.385),
        (Drive(50.0, 50.0, normalized=True), 2.6925),
        (Drive(200.0, 200.0, normalized=True), 5.385),
    ],
)
def test_drive_when_too_fast_or_normalized_is_in_rad_s(command: Drive, speed_rad_s: float) -> None:
    robot = spawn()
    robot.drive_wheels(command, 0.0)
    step(robot, 1)
    assert position(robot)[0] == pytest.approx(speed_rad_s * 0.13 * TICK_S, rel=1e-9)


HALTING = Drive(2.0, 2.0, halt_after_s=0.1)


@pytest.mark.parametrize(
    ("commands", "ticks"),
    [
        ([(0, HALTING)], 4),
        # Each command of a side counts anew, or ends the watch; a light does neither.
        ([(0, HALTING), (3, HALTING)], 7),
        ([(0, HALTING), (3, Drive(2.0))], 20),
        ([(0, HALTING), (3, Drive(light=True))], 4),
        ([(0, Drive(2.0, 2.0, halt_after_s=-1.0))], 0),
        ([(0, Drive(2.0, 2.0))], 20),
    ],
)
def test_robot_whose_driver_falls_silent_halts_in_time(
    commands: list[tuple[int, Drive]], ticks: int
) -> None:
    robot, due = spawn(), dict(commands)
    for tick in range(20):
        if tick in due:
            robot.drive_wheels(due[tick], tick * TICK_S)
        step(robot, 1, since=tick)
    assert position(robot)[0] == pytest.approx(2.0 * 0.13 * TICK_S * ticks)


def test_chassis_when_standing_rides_at_its_height() -> None:
    np.testing.assert_array_equal(spawn().world_from_robot.translation, (0.0, 0.0, -0.1457))


def test_battery_when_it_runs_down_counts_whole_seconds_left() -> None:
    robot = spawn(make_p2at(battery_s=10.0), time_s=5.0)
    left = [report.battery_s for t in (5.0, 5.1, 14.9, 15.0, 20.0) for report in status(robot, t)]
    assert left == [10, 9, 0, 0, 0]


def status(robot: Robot, time_s: float) -> list[VehicleStatus]:
    reports = robot.read_all(time_s)
    return [report for report in reports if isinstance(report, VehicleStatus)]


def test_robot_with_an_empty_battery_stops_and_ignores_commands() -> None:
    robot = spawn(make_p2at(battery_s=1.0))
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    step(robot, 100)
    robot.drive_wheels(Drive(2.0, 2.0, light=True), 2.0)
    step(robot, 10, since=100)
    # The tick that ends at 1.0 s no longer moves.
    assert position(robot)[0] == pytest.approx(2.0 * 0.13 * 0.98, abs=1e-9)
    assert not status(robot, 2.0)[0].light


def test_light_when_switched_is_in_the_status_until_switched_again() -> None:
    robot = spawn()
    robot.drive_wheels(Drive(light=True), 0.0)
    robot.drive_wheels(Drive(1.0, 1.0), 0.0)
    assert status(robot, 0.0)[0].light
    robot.drive_wheels(Drive(light=False), 0.0)
    assert not status(robot, 0.0)[0].light


def test_readings_of_a_whole_cycle_end_with_the_status() -> None:
    kinds = [type(report) for report in spawn().read_all(1.5)]
    assert kinds == [OdometryReading, GroundTruthReading, VehicleStatus]


@pytest.mark.parametrize("interval_s", [0.01, 0.02, 0.05, 0.033, 0.07])
def test_due_times_when_no_multiple_of_a_tick_keep_their_mean(interval_s: float) -> None:
    odometry = type(ODOMETRY)("Odometry", interval_s)
    robot = spawn(make_p2at(sensors=(odometry,), status_interval_s=60.0))
    ticks = 5000
    reports = sum(len(robot.read_due(tick * TICK_S)) for tick in range(ticks))
    # One more at time 0, and the status twice in 100 s; a tick is the shortest period.
    expected = ticks * TICK_S / max(interval_s, TICK_S)
    assert reports - 2 == pytest.approx(expected, abs=1.5)


def test_sensor_when_named_like_the_status_word_reports_beside_it() -> None:
    robot = spawn(make_p2at(sensors=(type(ODOMETRY)("STA", 0.1),)))
    assert [len(robot.read_due(t)) for t in (0.0, 0.1, 0.2)] == [2, 1, 2]


def test_odometry_when_blocked_by_a_wall_continues() -> None:
    robot = spawn()
    wall = make_ground(make_walled_world(0.5)).move
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    for tick in range(1, 201):
        robot.step(TICK_S, tick * TICK_S, wall)
    reading = robot.read_all(4.0)[0]
    assert isinstance(reading, OdometryReading)
    assert reading.x_m == pytest.approx(1.04, abs=1e-9)
    nose = position(robot)[0] + 0.5 * 0.5238
    assert 0.5 - 1e-3 < nose <= 0.5


def test_odometry_when_driving_a_circle_closes_it() -> None:
    robot = spawn()
    robot.drive_wheels(Drive(2.0, 1.0), 0.0)
    turn_per_tick = 0.13 * TICK_S / 0.4712
    ticks = round(2.0 * math.pi / turn_per_tick)
    step(robot, ticks)
    reading = robot.read_all(ticks * TICK_S)[0]
    assert isinstance(reading, OdometryReading)
    # Without noise odometry is exact; the last tick ends at most half a tick's travel short.
    assert (reading.x_m, reading.y_m) == pytest.approx(position(robot), abs=1e-9)
    assert math.hypot(reading.x_m, reading.y_m) < 0.5 * 1.5 * 0.13 * TICK_S + 1e-9


def test_configuration_when_of_the_robot_names_the_model() -> None:
    (configuration,) = execute_get_conf(spawn(), GetConf("Robot"))
    assert isinstance(configuration, VehicleConfiguration)
    assert (configuration.vehicle_type, configuration.name) == ("GroundVehicle", "OmniP2AT")
    assert configuration.max_speed_rad_s == 5.385


@pytest.mark.parametrize("type_", ["Odometry", "odometry"])
def test_part_when_of_a_sensor_is_found_in_any_case(type_: str) -> None:
    (part,) = spawn().find_parts_of_type(type_)
    assert (part.type, part.name) == ("Odometry", "Odometry")


def test_geometry_when_of_the_robot_is_the_reference_p2at() -> None:
    (geometry,) = execute_get_geo(spawn(), GetGeo("Robot"))
    assert isinstance(geometry, VehicleGeometry)
    assert geometry.dimensions_m == (0.5238, 0.4968, 0.2913)
    assert (geometry.wheel_radius_m, geometry.wheel_separation_m) == (0.13, 0.4712)


FLIPPERS = MissionPackageDescription(
    "JointParts",
    tuple(
        LinkDescription(
            name, CHASSIS_PARENT, (0.2, y_m, 0.0), (0.0, 0.5 * math.pi, 0.5 * math.pi), 1.0, 20.0
        )
        for name, y_m in (("FRFlipper", 0.1), ("FLFlipper", -0.1))
    ),
)


def test_flippers_when_driven_are_reported_by_status_and_encoders() -> None:
    encoder = dataclasses.replace(ENCODER, name="ECFlipper", shaft="frflipper")
    robot = spawn(make_p2at(chassis_joints=FLIPPERS, sensors=(encoder,)))
    robot.drive_joint("frflipper", 0.5, 0)
    step(robot, 100)
    counted, status = robot.read_all(2.0)
    assert isinstance(counted, EncoderReadings)
    assert isinstance(status, VehicleStatus)
    assert status.joints == (("FRFlipper", 0.5), ("FLFlipper", 0.0))
    assert counted.items == (("ECFlipper", 28),)


def test_flippers_are_no_mission_package() -> None:
    assert spawn(make_p2at(chassis_joints=FLIPPERS)).find_parts_of_type("MisPkg") == []


@pytest.mark.parametrize(("name", "is_named_alike"), [("Slip", True), ("slip", False)])
def test_odometry_named_slip_has_random_numbers_of_its_own(name: str, is_named_alike: bool) -> None:
    odometry = dataclasses.replace(ODOMETRY, name=name, distance_noise_m=0.01)
    robot = spawn(make_p2at(sensors=(odometry,)))
    robot.drive_wheels(Drive(5.0, 5.0), 0.0)
    step(robot, 1)
    reading = robot.read_all(TICK_S)[0]
    assert isinstance(reading, OdometryReading)
    travel_m = 5.0 * 0.13 * TICK_S
    variate = RandomSource.from_names(1, "R", name).normal_variates(1, 3)[0]
    expected_m = travel_m + 0.01 * math.sqrt(travel_m) * variate
    assert (reading.x_m == pytest.approx(expected_m)) is is_named_alike


def test_package_when_commanded_with_gripper_and_sequence_moves_links_only() -> None:
    robot = spawn(make_p2at(mission_packages=(STANDARD_PACKAGES["camerapantilt"],), sensors=()))
    links = (LinkCommand(2, 0.05),)
    robot.drive_mission_package(MisPkg("CameraPanTilt", links, gripper=1.0, sequence=3.0))
    robot.drive_mission_package(MisPkg("CameraPanTilt", gripper=0.0))
    step(robot, 50)
    status, _ = robot.read_all(1.0)
    assert isinstance(status, MissionPackageStatus)
    assert [link.value for link in status.links] == [0.0, 0.05]


AHEAD = PerspectiveCameraDescription("Ahead", Mount(), 12, 10, 1.0, 0.3, 2.0)


def test_noise_when_time_passes_has_another_seed_and_when_requested_again_the_same() -> None:
    robot = spawn(make_p2at(perspective_cameras=(AHEAD,)))
    first, again = robot.noise_seed_for("OmniCam"), robot.noise_seed_for("OmniCam")
    step(robot, 1)
    later = robot.noise_seed_for("OmniCam")
    assert first == again
    assert (later.camera_key, later.tick) == (first.camera_key, first.tick + 1)
    assert robot.noise_seed_for("Ahead").camera_key != first.camera_key


def test_twist_of_a_robot_is_its_true_motion() -> None:
    robot = spawn()
    robot.step(0.02, 0.02, LEVEL)
    assert robot.twist == AT_REST
    robot.drive_wheels(Drive(left=2.0, right=1.0), 0.02)
    before = robot.world_from_robot
    robot.step(0.02, 0.04, LEVEL)
    after = robot.twist.integrate_pose(before, 0.02)
    np.testing.assert_allclose(after.translation, robot.world_from_robot.translation, atol=1e-12)
    np.testing.assert_allclose(after.rotation, robot.world_from_robot.rotation, atol=1e-12)
    robot.drive_wheels(Drive(left=0.0, right=0.0), 0.04)
    robot.step(0.02, 0.06, LEVEL)
    assert robot.twist == AT_REST


def test_twist_of_a_robot_that_turns_over_is_more_than_a_quarter_turn() -> None:
    def turn_over(body: RobotBody, travel: WheelTravel, duration_s: float) -> RobotBody:
        turned = Pose.from_rpy((0.0, 0.0, 0.0), (2.5, 0.3, -0.2))
        return dataclasses.replace(body, world_from_robot=body.world_from_robot @ turned)

    robot = spawn()
    before = robot.world_from_robot
    robot.step(0.02, 0.02, turn_over)
    after = robot.twist.integrate_pose(before, 0.02)
    np.testing.assert_allclose(after.rotation, robot.world_from_robot.rotation, atol=1e-12)


def due_reports(robot: Robot, *times_s: float) -> list[list[type]]:
    return [[type(report) for report in robot.read_due(time_s)] for time_s in times_s]


def test_reports_are_due_at_once_and_then_by_their_periods() -> None:
    sensors = (
        dataclasses.replace(ODOMETRY, interval_s=0.2),
        dataclasses.replace(GROUND_TRUTH, interval_s=0.5),
    )
    robot = spawn(make_p2at(sensors=sensors, status_interval_s=9.0), time_s=1.0)
    odometry, truth = OdometryReading, GroundTruthReading
    found = due_reports(robot, 1.0, 1.1, 1.2, 1.4, 1.5)
    assert found == [[odometry, truth, VehicleStatus], [], [odometry], [odometry], [truth]]


def test_report_when_time_jumped_does_not_catch_up() -> None:
    robot = spawn(make_p2at(sensors=(), status_interval_s=0.2))
    assert due_reports(robot, 10.0, 10.02, 10.04) == [[VehicleStatus], [VehicleStatus], []]


def make_fleet() -> Fleet:
    world = make_walled_world()
    return Fleet([make_p2at()], world, build_scene(world), seed=1)


def spawn_in(fleet: Fleet, name: str, x_m: float = 0.0) -> FakeClient:
    client = FakeClient()
    fleet.execute(client, Init("OmniP2AT", name=name, location_m=(x_m, 0.0, 0.0)), 0.0)
    return client


def test_state_of_an_empty_fleet_is_empty() -> None:
    state = make_fleet().get_state("")
    assert (state.robots, state.robot, state.reports, state.notes) == ((), "", (), ())


def test_state_lists_all_robots_and_details_the_displayed_one() -> None:
    fleet = make_fleet()
    first = spawn_in(fleet, "A")
    spawn_in(fleet, "B", 5.0)
    fleet.execute(first, Drive(1.0, 2.0), 0.0)
    fleet.execute(first, ShareControl(True), 0.0)
    state = fleet.get_state("")
    assert [one.name for one in state.robots] == ["A", "B"]
    assert [one.wheel_speeds_rad_s for one in state.robots] == [(1.0, 2.0), (0.0, 0.0)]
    assert [one.shares_control for one in state.robots] == [True, False]
    assert state.robot == "A"
    assert state.robots[0].class_name == "USARBot.OmniP2AT"


def test_state_has_the_pose_of_now_and_that_of_the_start() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A", 1.0)
    fleet.execute(client, Drive(2.0, 2.0), 0.0)
    for tick in range(1, 101):
        fleet.step(0.02, 0.02 * tick)
    (snapshot,) = fleet.get_state("A").robots
    np.testing.assert_allclose(snapshot.world_from_start.translation[:2], [1.0, 0.0], atol=1e-12)
    # 2 rad/s * 0.13 m * 2 s.
    np.testing.assert_allclose(snapshot.world_from_robot.translation[:2], [1.52, 0.0], atol=1e-9)


@pytest.mark.parametrize("name", ["a", "C", "A\0"])
def test_state_of_an_unknown_robot_has_no_details(name: str) -> None:
    fleet = make_fleet()
    spawn_in(fleet, "A")
    state = fleet.get_state(name)
    assert (len(state.robots), state.robot, state.reports) == (1, "", ())


def test_state_has_the_newest_report_of_each_sensor_once() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A")
    for tick in range(1, 21):
        fleet.step(0.02, 0.02 * tick)
        fleet.deliver_due_reports(0.02 * tick)
    reports = fleet.get_state("A").reports
    assert [type(one) for one in reports] == [OdometryReading, GroundTruthReading, VehicleStatus]
    assert reports == client.batches[-1]
    assert reports[1].time_s == pytest.approx(0.4)  # type: ignore[union-attr] # a GroundTruthReading


def test_note_replaces_the_one_of_its_name() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A")
    for time_s, text in enumerate(['{"x":1}', '{"x":2}']):
        fleet.publish(client, Note("ekf", text), float(time_s))
    assert fleet.get_state("A").notes == ((Note("ekf", '{"x":2}'), 1.0),)


def test_notes_when_flooded_are_limited_and_the_old_ones_stay() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A")
    for i in range(MAX_NOTES):
        fleet.publish(client, Note(f"note {i}", "{}"), 0.0)
    for i in range(MAX_NOTES, 1000):
        with pytest.raises(LocalProtocolError, match="8 names"):
            fleet.publish(client, Note(f"note {i}", "{}"), 0.0)
    assert [note.name for note, _ in fleet.get_state("A").notes] == [f"note {i}" for i in range(8)]


def test_notes_of_the_control_port_are_stored_and_limited() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A")
    for number in range(MAX_NOTES + 1):
        fleet.execute(client, Note(f"note {number}", "{}"), 0.0)
    assert len(fleet.get_state("A").notes) == MAX_NOTES


def test_notes_go_with_their_robot() -> None:
    fleet = make_fleet()
    client = spawn_in(fleet, "A")
    fleet.publish(client, Note("ekf", "{}"), 0.0)
    fleet.remove(client)
    with pytest.raises(RejectedError, match="this client has no robot"):
        fleet.publish(client, Note("ekf", "{}"), 0.0)
    spawn_in(fleet, "A")
    assert fleet.get_state("A").notes == ()


def test_commands_beyond_their_room_leave_a_gap_in_the_numbers() -> None:
    log = CommandLog()
    name = "x" * 1000
    for number in range(400):
        log.add(DriveJoints((JointCommand(name, float(number)),)), 0.5 * number)
    found = log.list_after(0)
    assert 64 >= len(found) > 50
    assert found[0][0] > 100
    assert [one[0] for one in found] == list(range(found[0][0], found[0][0] + len(found)))
    assert log.list_after(399)[0][1:2] == (199.5,)
    assert log.list_after(400) == ()


def test_command_that_is_no_line_leaves_a_gap_in_the_numbers() -> None:
    log = CommandLog()
    log.add(Init("P2AT", name="a}"), 0.5)
    log.add(Init("P2AT", name="\xff"), 0.75)
    assert log.list_after(0) == ((2, 0.75, "INIT {ClassName P2AT} {Name \xff}"),)
