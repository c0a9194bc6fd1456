"""Notes, states and shared control of a real server, by clients of both transports."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.replies import RobotState, StateReply
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S, RunningServer, start_server

ROBOT = "USARBot.OmniP2AT"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with start_server(tmp_path_factory.mktemp("shared")) as running:
        yield running


def wait_for_state(
    client: StreamClient, robot: str, predicate: Callable[[StateReply], bool]
) -> StateReply:
    """State of a robot once it satisfies a predicate."""
    deadline = Deadline(f"expected state of {robot}", DEADLINE_S)
    while not predicate(state := client.get_state(robot)):
        deadline.check()
    return state


def find_robot(state: StateReply, name: str) -> RobotState:
    return next(robot for robot in state.robots if robot.name == name)


def test_robot_of_the_control_port_is_watched_driven_and_halted(server: RunningServer) -> None:
    with server.connect_robot() as owner, server.connect_stream() as watcher:
        owner.spawn(ROBOT, name="Owned", location_m=(0.0, 0.0, 0.0))
        with pytest.raises(CatoptraError, match="does not share its control"):
            watcher.drive(1.0, -1.0, robot="Owned")
        owner.publish("ekf", {"pose": np.array([1.0, 2.0, 0.5]), "text": "\u03c3"})
        owner.share_control()
        state = wait_for_state(
            watcher, "Owned", lambda state: find_robot(state, "Owned").shares_control
        )
        (note,) = state.notes
        assert json.loads(note.text) == {"pose": [1.0, 2.0, 0.5], "text": "\u03c3"}
        assert any("{Type Odometry}" in line for line in state.reports)
        with server.connect_stream() as driver:
            driver.drive(1.0, -1.0, robot="Owned")
            rolling = find_robot(watcher.get_state("Owned"), "Owned")
            assert rolling.wheel_speeds_rad_s == (1.0, -1.0)
        # The driver has disconnected.
        halted = wait_for_state(
            watcher,
            "Owned",
            lambda state: find_robot(state, "Owned").wheel_speeds_rad_s == (0.0, 0.0),
        )
        start = find_robot(halted, "Owned").world_from_start
        assert start.position_m[:2] == (0.0, 0.0)
    with server.connect_stream() as watcher:
        gone = wait_for_state(watcher, "Owned", lambda state: not state.robots)
        assert (gone.robot, gone.notes) == ("", ())
        with pytest.raises(CatoptraError, match="there is no robot 'Owned'"):
            watcher.drive(1.0, 1.0, robot="Owned")


def test_notes_when_flooded_disturb_nobody(server: RunningServer) -> None:
    note = {"text": 8000 * "x"}
    with server.connect_stream() as flooding, server.connect_stream() as other:
        flooding.spawn(ROBOT, name="Flooding", location_m=(0.0, 0.0, 0.0))
        other.spawn(ROBOT, name="Other", location_m=(2.0, 0.0, 0.0))
        for number in range(8):
            flooding.publish(f"note {number}", note)
        for number in range(50):
            with pytest.raises(CatoptraError, match="8 names"):
                flooding.publish(f"another {number}", note)
        flooding.publish("note 3", {"text": "short"})
        state = other.get_state("Flooding")
        assert [one.name for one in state.notes] == [f"note {number}" for number in range(8)]
        assert state.notes[3].text == '{"text":"short"}'
        assert other.get_state("Other").notes == ()
