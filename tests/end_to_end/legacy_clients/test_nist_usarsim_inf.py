"""NIST's usarsim_inf (ROS): reads 8 bytes at a time, and queries every sensor that reports."""

from __future__ import annotations

import re
from collections import Counter, deque

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket
from helpers.server_process import DEADLINE_S, RunningServer


class UsarsimInf:
    """The client's queue of queries: one outstanding CONF and one GEO, without a timeout.

    A reply without content repeats the query at once; a missing reply blocks the queue. RFID is
    queried once in any case. Keys are compared case-sensitively.
    """

    def __init__(self, wire: LineSocket) -> None:
        self.wire = wire
        self.queries: Counter[str] = Counter()
        self.replies: dict[tuple[str, str, str], str] = {}
        self._known: set[tuple[str, str]] = set()
        self._waiting: dict[str, deque[tuple[str, str]]] = {"CONF": deque(), "GEO": deque()}

    def start(self) -> None:
        """Spawn the robot, and query the robot and RFID."""
        self.wire.send("INIT {Classname USARBot.P2AT} {Name robot1} {Location 0.0,0.0,0.0}\r\n")
        self.wire.send("GETCONF {Type RFID}\r\nGETGEO {Type RFID}\r\n")
        self._register("Robot", "robot1")

    def listen(self) -> str:
        """Read and handle one line."""
        line = self.wire.read_line()
        word, blocks = line.partition(" ")[0], re.findall(r"\{(\S+) ?([^}]*)\}", line)
        if word == "SEN":
            self._handle_blocks(blocks)
        elif word in self._waiting:
            self._handle_reply(word, line)
        return line

    @property
    def is_drained(self) -> bool:
        """Whether no query is outstanding."""
        return not any(self._waiting.values())

    def drive(self, linear_m_s: float, angular_rad_s: float) -> str:
        """Send a twist, angular counter-clockwise, as wheel speeds by the robot's GEO."""
        geometry = self.replies["GEO", "Robot", "robot1"]
        radius, track = (_parse_number(geometry, key) for key in ("WheelRadius", "WheelSeparation"))
        left = (linear_m_s - 0.5 * track * angular_rad_s) / radius
        right = (linear_m_s + 0.5 * track * angular_rad_s) / radius
        command = f"Drive {{Left {left:f}}} {{Right {right:f}}}"
        self.wire.send(command + "\r\n")
        return command

    def _handle_blocks(self, blocks: list[tuple[str, str]]) -> None:
        type_ = next(value for key, value in blocks if key == "Type")
        for name in (value.split(" ")[0] for key, value in blocks if key == "Name"):
            self._register(type_, name)

    def _register(self, type_: str, name: str) -> None:
        if (type_, name) in self._known:
            return
        self._known.add((type_, name))
        for word, waiting in self._waiting.items():
            waiting.append((type_, name))
            if len(waiting) == 1:
                self._request(word)

    def _request(self, word: str) -> None:
        type_, name = self._waiting[word][0]
        command = f"GET{word} {{Type {type_}}} {{Name {name}}}\r\n"
        self.queries[command] += 1
        self.wire.send(command)

    def _handle_reply(self, word: str, line: str) -> None:
        waiting = self._waiting[word]
        if "{Type RFID}" in line and (not waiting or waiting[0][0] != "RFID"):
            return  # reply to the single query of RFID
        type_, name = waiting[0]
        expected = "GroundVehicle" if type_ == "Robot" else type_
        assert f"{{Type {expected}}}" in line, f"{line} is no reply to the query of {type_} {name}"
        if line.count("{") > 2 or f"{{Name {name} Location" in line:
            self.replies[word, type_, name] = line
            waiting.popleft()
        if waiting:
            self._request(word)


def _parse_number(line: str, key: str) -> float:
    found = re.search(rf"\{{{key} (-?[\d.]+)\}}", line)
    assert found, f"{key} is not in {line}"
    return float(found[1])


@pytest.fixture
def client(server: RunningServer):
    """A client that has queried all its sensors."""
    with LineSocket(server.control_port, size=8) as wire:
        client = UsarsimInf(wire)
        client.start()
        deadline = Deadline("replies to all queries", DEADLINE_S)
        while not client.listen().startswith("STA"):
            deadline.check()
        while not client.is_drained:
            deadline.check()
            client.listen()
        yield client


def test_queries_when_sent_one_by_one_have_replies_and_are_not_repeated(client: UsarsimInf) -> None:
    # The robot, 16 sonars, scanner, INS, odometry, 4 encoders, touch, RFID, VictSensor, truth, GPS.
    assert len(client.queries) == 2 * 29
    assert set(client.queries.values()) == {1}
    assert set(client.replies) == {
        (word, type_, name) for word in ("CONF", "GEO") for type_, name in client._known
    }


def test_queries_when_all_have_replies_are_not_sent_again(client: UsarsimInf) -> None:
    before = client.queries.total()
    deadline = Deadline("third STA line", DEADLINE_S)
    for _ in range(3):
        while not client.listen().startswith("STA"):
            deadline.check()
    assert client.queries.total() == before


def test_scanner_when_read_case_sensitively_has_its_field_of_view(client: UsarsimInf) -> None:
    scanner = client.replies["CONF", "RangeScanner", "Scanner1"]
    assert _parse_number(scanner, "Fov") == pytest.approx(3.1415)
    assert _parse_number(scanner, "MaxRange") == 20.0
    scan = client.wire.read_line_starting_with("SEN {Time")
    deadline = Deadline("scan", DEADLINE_S)
    while "{Type RangeScanner}" not in scan:
        deadline.check()
        scan = client.wire.read_line_starting_with("SEN {Time")
    assert _parse_number(scan, "FOV") == pytest.approx(3.1415)


def test_drive_when_counter_clockwise_turns_the_robot_left(client: UsarsimInf) -> None:
    assert client.drive(0.2, 0.1) == "Drive {Left 1.357231} {Right 1.719692}"
    yaw = x = y = 0.0
    deadline = Deadline("movement of 0.3 m", DEADLINE_S)
    while x < 0.3:
        deadline.check()
        truth = client.listen()
        if "{Type GroundTruth}" in truth:
            x, y, _ = _parse_vector(truth, "Location")
            yaw = _parse_vector(truth, "Orientation")[2]
    # SAE: left is y < 0 and a yaw that falls from 2 pi. 0.1 rad/s for some 1.5 s.
    assert 6.0 < yaw < 6.25
    assert y < 0.0


def _parse_vector(line: str, key: str) -> tuple[float, float, float]:
    found = re.search(rf"\{{{key} ([^}}]*)\}}", line)
    assert found, f"{key} is not in {line}"
    x, y, z = map(float, found[1].split(","))
    return x, y, z
