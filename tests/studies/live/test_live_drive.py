"""A lap on a server in real time, seen by another client: notes near the truth, shared wheels."""

from __future__ import annotations

import json
import math
import statistics
import threading

import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_protocol.stream.replies import RobotState, StateReply
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.scene_mesh import build_scene
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.localization_filter import NOTE_NAME
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.live.live_drive import ROBOT_NAME, open_live_drive
from helpers.configs import ROBOTS, WORLDS
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S, RunningServer, start_server

# One metre in the middle of the field: a robot that turns beside a beacon would touch it.
SHORT_ROUTE = tuple(Waypoint(0.6 - 0.2 * step, 0.0, math.pi) for step in range(6))
# The filter errs by 3 cm on a free machine.
NEAR_M = 0.15


@pytest.fixture
def server(tmp_path):
    with start_server(tmp_path, robot=ROBOTS / "p2at_omni_live.ini") as running:
        yield running


class DriveThread:
    """A drive of a number of laps in a thread, and the error that ended it."""

    def __init__(self, server: RunningServer, num_laps: int | None = None) -> None:
        self.error: BaseException | None = None
        self._address = ServerAddress(
            "127.0.0.1", server.control_port, server.image_port, server.stream_port
        )
        self._num_laps = num_laps
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def join(self) -> None:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive(), "the drive did not end"

    @property
    def has_ended(self) -> bool:
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            with open_live_drive(self._address, SHORT_ROUTE) as drive:
                drive.run(self._num_laps)
        except BaseException as error:
            self.error = error


def find_robot(state: StateReply) -> RobotState | None:
    return next((robot for robot in state.robots if robot.name == ROBOT_NAME), None)


def find_note(state: StateReply) -> dict[str, object]:
    return next((json.loads(note.text) for note in state.notes if note.name == NOTE_NAME), {})


def test_drive_publishes_beliefs_near_the_truth(server):
    drive, places, notes = DriveThread(server), [], {}
    deadline = Deadline("ten beliefs", DEADLINE_S)
    with server.connect_stream() as viewer:
        while len(beliefs := [note for note in notes.values() if note.get("detections")]) < 10:
            state = viewer.get_state(ROBOT_NAME)
            robot, note = find_robot(state), find_note(state)
            notes[str(note.get("text"))] = note
            if robot:
                places.append(robot.world_from_robot.position_m[:2])
            deadline.check()
    server.process.kill()
    drive.join()
    assert any("training the classifier" in text for text in notes)
    # The path, not the place of the moment: a busy machine publishes a belief late.
    errors_m = [min(math.dist(note["pose"][:2], place) for place in places) for note in beliefs]
    assert statistics.median(errors_m) < NEAR_M
    assert all(len(note["covariance"]) == 9 for note in beliefs)
    accepted = [detection["accepted"] for note in beliefs for detection in note["detections"]]
    assert sum(accepted) > 0.5 * len(accepted)


def test_viewer_drives_and_the_robot_returns_to_its_route_until_the_last_lap(server):
    drive = DriveThread(server, num_laps=1)
    with server.connect_stream() as viewer:
        deadline = Deadline("robot that drives", DEADLINE_S)
        while not (robot := find_robot(viewer.get_state(ROBOT_NAME))) or not any(
            robot.wheel_speeds_rad_s
        ):
            deadline.check()
        viewer.drive(1.0, -1.0, robot=ROBOT_NAME)
        deadline = Deadline("note of the viewer's drive", DEADLINE_S)
        while not str(find_note(viewer.get_state(ROBOT_NAME)).get("text")).startswith("driven by"):
            # As the page does: a command on the way may have been overtaken.
            viewer.drive(1.0, -1.0, robot=ROBOT_NAME)
            deadline.check()
        robot = find_robot(viewer.get_state(ROBOT_NAME))
        assert robot.shares_control
        assert robot.wheel_speeds_rad_s == (1.0, -1.0)
        viewer.drive(0.0, 0.0, robot=ROBOT_NAME)
        drive.join()
    assert drive.error is None


def test_server_when_lost_ends_the_drive_with_its_reason(server):
    drive = DriveThread(server)
    with server.connect_stream() as viewer:
        deadline = Deadline("robot", DEADLINE_S)
        while not find_robot(viewer.get_state(ROBOT_NAME)):
            deadline.check()
    server.process.kill()
    drive.join()
    assert "lost the" in str(drive.error)


def test_arena_is_free_along_the_route():
    (robot,) = read_robots(ROBOTS / "p2at_omni_live.ini")[0]
    scene = build_scene(read_world(WORLDS / "arena.ini")[0])
    index = CollisionIndex(scene, commit_ray_caster(scene))
    for waypoint in SIM.route:
        # A robot that turns leaves the line by a few centimetres. Raises where there is no room.
        pose = PlanarPose(waypoint.x_m, waypoint.y_m, waypoint.yaw_rad)
        body = index.place(robot, pose, clearance_m=0.1)
        assert body.world_from_robot.rotation[2, 2] == 1.0
