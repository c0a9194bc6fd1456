"""State of a fleet for viewers: all robots, readings and notes of one."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.limits import MAX_NOTES
from catoptra_protocol.usarsim.commands import Drive, Init, Note, ShareControl
from catoptra_protocol.usarsim.reports import (
    GroundTruthReading,
    OdometryReading,
    VehicleStatus,
)
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import FakeClient, make_p2at, make_walled_world


def make_fleet() -> Fleet:
    world = make_walled_world()
    return Fleet([make_p2at()], world, build_scene(world), seed=1)


def spawn(fleet: Fleet, name: str, x_m: float = 0.0) -> FakeClient:
    client = FakeClient()
    fleet.execute(client, Init("OmniP2AT", name=name, location_m=(x_m, 0.0, 0.0)), 0.0)
    return client


def test_state_of_an_empty_fleet_is_empty() -> None:
    state = make_fleet().get_state("")
    assert (state.robots, state.robot, state.reports, state.notes) == ((), "", (), ())


def test_state_lists_all_robots_and_details_the_displayed_one() -> None:
    fleet = make_fleet()
    first = spawn(fleet, "A")
    spawn(fleet, "B", 5.0)
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
    client = spawn(fleet, "A", 1.0)
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
    spawn(fleet, "A")
    state = fleet.get_state(name)
    assert (len(state.robots), state.robot, state.reports) == (1, "", ())


def test_state_has_the_newest_report_of_each_sensor_once() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "A")
    for tick in range(1, 21):
        fleet.step(0.02, 0.02 * tick)
        fleet.deliver_due_reports(0.02 * tick)
    reports = fleet.get_state("A").reports
    assert [type(one) for one in reports] == [OdometryReading, GroundTruthReading, VehicleStatus]
    assert reports == client.batches[-1]
    assert reports[1].time_s == pytest.approx(0.4)  # type: ignore[union-attr] # a GroundTruthReading


def test_note_replaces_the_one_of_its_name() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "A")
    for time_s, text in enumerate(['{"x":1}', '{"x":2}']):
        assert fleet.publish(client, Note("ekf", text), float(time_s)) == ""
    (published,) = fleet.get_state("A").notes
    assert (published.note, published.time_s) == (Note("ekf", '{"x":2}'), 1.0)


def test_notes_when_flooded_are_limited_and_the_old_ones_stay() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "A")
    reasons = [fleet.publish(client, Note(f"note {i}", "{}"), 0.0) for i in range(1000)]
    assert reasons[:MAX_NOTES] == [""] * MAX_NOTES
    assert all("8 names" in reason for reason in reasons[MAX_NOTES:])
    assert [one.note.name for one in fleet.get_state("A").notes] == [f"note {i}" for i in range(8)]


def test_notes_of_the_control_port_are_stored_and_limited() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "A")
    for number in range(MAX_NOTES + 1):
        fleet.execute(client, Note(f"note {number}", "{}"), 0.0)
    assert len(fleet.get_state("A").notes) == MAX_NOTES


def test_notes_go_with_their_robot() -> None:
    fleet = make_fleet()
    client = spawn(fleet, "A")
    fleet.publish(client, Note("ekf", "{}"), 0.0)
    fleet.remove(client)
    assert fleet.publish(client, Note("ekf", "{}"), 0.0) == "this client has no robot"
    spawn(fleet, "A")
    assert fleet.get_state("A").notes == ()
