"""The bundled classes and start poses of clients that name neither P2AT nor a free location."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from helpers.configs import ROBOTS, WORLDS
from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket
from helpers.server_process import DEADLINE_S, RunningServer, start_server

# As their programs send them; model of the robot that replies.
INITS = [
    # makokal's script.
    ("INIT {ClassName USARBot.KR6} {Location .4, .4, 1.8}", "KR6"),
    # The AirRobot clients in MATLAB, and in Python under a comma-decimal locale.
    ("INIT {ClassName USARBot.AirRobot} {Name altURI_R1} {Location 1.2,2.5,1.8}", "AirRobot"),
    (
        "INIT {ClassName USARBot.AIRRobot} {Location 0,0000, 0,0000, 0,0000} "
        "{Rotation 0,0000, 0,0000, 0,0000}",
        "AirRobot",
    ),
    # UvA's commander by a start pose of DM-RoboCupTraining, usarsim_inf of NIST.
    ("INIT {ClassName USARBot.P2AT} {Name UvA} {Start RobotStart1}", "P2AT"),
    ("INIT {ClassName P2AT} {Name NIST} {Start RobotStart2}", "P2AT"),
    # The sample of the Gazebo clone, in its form and by its start pose alone.
    (
        "INIT {ClassName pioneer3at_with_sensors}{Name Robo_A}{Location 1,-2,0}"
        "{Rotation 0,0,0}{Start Point1}",
        "pioneer3at_with_sensors",
    ),
    ("INIT {ClassName pioneer3at_with_sensors}{Start Point1}", "pioneer3at_with_sensors"),
]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Serve the legacy configuration."""
    folder = tmp_path_factory.mktemp("legacy_configuration")
    robot, world = ROBOTS / "legacy.ini", WORLDS / "legacy.ini"
    with start_server(folder, robot=robot, world=world) as running:
        yield running
        assert running.terminate() == 0
        log = running.log.read_text()
        assert "Traceback" not in log
        assert "altURI_R1 is a robot on wheels in place of a flying one" in log


@pytest.mark.parametrize(("init", "model"), INITS)
def test_init_of_an_old_client_spawns_its_robot(
    server: RunningServer, init: str, model: str
) -> None:
    with LineSocket(server.control_port, size=4024) as client:
        client.send(f"{init}\r\nGETGEO {{Type Robot}}\r\n")
        geometry = client.read_line_starting_with("GEO ")
        assert f"{{Name {model}}}" in geometry


def test_joints_of_the_arm_move(server: RunningServer) -> None:
    with LineSocket(server.control_port, size=4024) as client:
        client.send("INIT {ClassName KR6} {Start Point1}\r\nMULTIDRIVE {Joint2 -0.5}\r\n")
        deadline = Deadline("status with the joint's angle", DEADLINE_S)
        while "{Joint2 -0.5000}" not in client.read_line_starting_with("STA "):
            deadline.check()
