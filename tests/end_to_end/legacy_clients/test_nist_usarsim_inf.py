"""NIST's usarsim_inf (ROS): reads 8 bytes at a time, and asks for every sensor that it hears of."""

from __future__ import annotations

import re
from collections import Counter, deque

import pytest

from helpers.legacy_sockets import LineSocket
from helpers.server_process import RunningServer


class UsarsimInf:
    """The client's queue of questions: one outstanding CONF and one GEO, never given up.

    An answer without content makes it ask the same again at once; silence holds up all behind it.
    RFID is asked for once, whatever comes. Keys are compared case-sensitively.
    """

    def __init__(self, wire: LineSocket) -> None:
        self.wire = wire
        self.asked: Counter[str] = Counter()
        self.answers: dict[tuple[str, str, str], str] = {}
        self._known: set[tuple[str, str]] = set()
        self._waiting: dict[str, deque[tuple[str, str]]] = {"CONF": deque(), "GEO": deque()}

    def start(self) -> None:
        """Bring the robot into the world, and ask for it and for RFID."""
        self.wire.send("INIT {Classname USARBot.P2AT} {Name robot1} {Location 0.0,0.0,0.0}\r\n")
        self.wire.send("GETCONF {Type RFID}\r\nGETGEO {Type RFID}\r\n")
        self._register("Robot", "robot1")

    def listen(self) -> str:
        """Take in one line; return it."""
        line = self.wire.read_line()
        word, blocks = line.partition(" ")[0], re.findall(r"\{(\S+) ?([^}]*)\}", line)
        if word == "SEN":
            self._handle_blocks(blocks)
        elif word in self._waiting:
            self._handle_answer(word, line)
        return line

    @property
    def is_drained(self) -> bool:
        """Return whether nothing is waited for."""
        return not any(self._waiting.values())

    def drive(self, linear_m_s: float, angular_rad_s: float) -> str:
        """Send a twist, angular counter-clockwise, as wheel speeds by the robot's GEO."""
        geometry = self.answers["GEO", "Robot", "robot1"]
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
        self.asked[command] += 1
        self.wire.send(command)

    def _handle_answer(self, word: str, line: str) -> None:
        waiting = self._waiting[word]
        if "{Type RFID}" in line and (not waiting or waiting[0][0] != "RFID"):
            return  # of the question that is asked once
        type_, name = waiting[0]
        wanted = "GroundVehicle" if type_ == "Robot" else type_
        assert f"{{Type {wanted}}}" in line, f"{line} answers no question after {type_} {name}"
        if line.count("{") > 2 or f"{{Name {name} Location" in line:
            self.answers[word, type_, name] = line
            waiting.popleft()
        if waiting:
            self._request(word)


def _parse_number(line: str, key: str) -> float:
    found = re.search(rf"\{{{key} (-?[\d.]+)\}}", line)
    assert found, f"{key} is not in {line}"
    return float(found[1])


@pytest.fixture
def client(server: RunningServer):
    """Yield a client that has been told of all its sensors."""
    with LineSocket(server.control_port, size=8) as wire:
        client = UsarsimInf(wire)
        client.start()
        while not client.listen().startswith("STA"):
            pass
        while not client.is_drained:
            client.listen()
        yield client


def test_questions_when_asked_one_by_one_are_answered_and_not_repeated(client: UsarsimInf) -> None:
    # The robot, 16 sonars, scanner, INS, odometry, 4 encoders, touch, RFID, VictSensor, truth, GPS.
    assert len(client.asked) == 2 * 29
    assert set(client.asked.values()) == {1}
    assert set(client.answers) == {
        (word, type_, name) for word in ("CONF", "GEO") for type_, name in client._known
    }


def test_questions_when_all_are_answered_stay_answered(client: UsarsimInf) -> None:
    before = client.asked.total()
    for _ in range(3):
        while not client.listen().startswith("STA"):
            pass
    assert client.asked.total() == before


def test_scanner_when_read_case_sensitively_tells_its_field_of_view(client: UsarsimInf) -> None:
    scanner = client.answers["CONF", "RangeScanner", "Scanner1"]
    assert _parse_number(scanner, "Fov") == pytest.approx(3.1415)
    assert _parse_number(scanner, "MaxRange") == 20.0
    scan = client.wire.read_line_starting_with("SEN {Time")
    while "{Type RangeScanner}" not in scan:
        scan = client.wire.read_line_starting_with("SEN {Time")
    assert _parse_number(scan, "FOV") == pytest.approx(3.1415)


def test_drive_when_counter_clockwise_turns_the_robot_left(client: UsarsimInf) -> None:
    assert client.drive(0.2, 0.1) == "Drive {Left 1.357231} {Right 1.719692}"
    yaw = x = y = 0.0
    while x < 0.3:
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
