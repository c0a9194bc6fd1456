"""AP2DX, maldo's Java client: a reader that discards bytes, and a parser that counts blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import connect, receive
from helpers.server_process import DEADLINE_S, RunningServer

_BUFFER_BYTES = 8192  # of a BufferedReader


@dataclass
class Ap2dx:
    """One robot, with the values parsed from its lines.

    Each turn reads one raw byte past the buffer and discards it, then a whole line from the buffer:
    the first letters at the head of the socket are lost. Lines are split at "} {", and the pieces
    are identified by position. The program's treatment of damaged lines is not documented; here a
    line has the type of its second piece.
    """

    port: int
    lines: list[str] = field(default_factory=list)
    sonars: list[dict[str, float]] = field(default_factory=list)
    scans: list[list[float]] = field(default_factory=list)
    status: list[tuple[int, int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._connection = connect(self.port)
        self._buffer = b""

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def send(self, text: str) -> None:
        """Send a line as the program does under Linux, whose println adds a LF of its own."""
        self._connection.sendall(text.encode() + b"\r\n\n")

    def turn(self) -> None:
        """Discard a byte, then read and parse a line."""
        receive(self._connection, 1)
        line = self._read_line()
        self.lines.append(line)
        pieces = line.split("} {")
        if line.startswith("STA "):
            self._read_status(pieces)
        elif len(pieces) > 2 and pieces[1] == "Type Sonar":
            self._read_sonars(pieces[2:])
        elif len(pieces) > 5 and pieces[1] == "Type RangeScanner":
            ranges = pieces[5].removesuffix("}").removeprefix("Range ")
            self.scans.append([float(text) for text in ranges.split(",")])

    def _read_line(self) -> str:
        while b"\n" not in self._buffer:
            self._buffer += receive(self._connection, _BUFFER_BYTES)
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.rstrip(b"\r").decode()

    def _read_status(self, pieces: list[str]) -> None:
        """Parse integers by position; any other text raises, as Integer.parseInt does."""
        values = [piece.strip("{}").split(" ")[1] for piece in pieces]
        light, battery, view = (int(values[index]) for index in (5, 6, 7))
        self.status.append((light, battery, view))

    def _read_sonars(self, pieces: list[str]) -> None:
        words = [piece.strip("{}").split(" ") for piece in pieces]
        found = {word[1]: float(word[3]) for word in words}
        assert len(found) == 16, "the program's arrays have 16 elements"
        self.sonars.append(found)


@pytest.fixture
def client(server: RunningServer):
    """A client with a robot in the room, after 60 lines."""
    client = Ap2dx(server.control_port)
    client.send("INIT {ClassName USARBot.P2AT} {Location 0.0 0.0 0.0} {Name AP2DX}")
    while len(client.lines) < 60:
        client.turn()
    yield client
    client.close()


def test_greeting_when_its_first_byte_is_discarded_leaves_later_lines_intact(client: Ap2dx) -> None:
    assert client.lines[0].startswith("FO {Gametype ")
    intact = [line for line in client.lines if line.startswith(("SEN {", "STA {", "MISSTA {"))]
    # A cycle is 13 lines in one piece: one of them is damaged, the first.
    assert len(intact) >= 0.8 * len(client.lines)


def test_cycle_when_parsed_by_position_is_complete(client: Ap2dx) -> None:
    assert len(client.status) >= 3
    assert {light for light, _, _ in client.status} == {0}
    assert all(1190 <= battery <= 1200 for _, battery, _ in client.status)
    assert {view for _, _, view in client.status} == {-1}
    assert client.scans
    assert {len(scan) for scan in client.scans} == {181}


def test_sonars_when_in_one_line_are_all_sixteen_and_on_their_sides(client: Ap2dx) -> None:
    assert client.sonars
    for sonar in client.sonars:
        # F1 and R8 point left at 2 m, F8 and R1 right at 3 m; each is mounted 0.13 m off the axis.
        assert sonar["F1"] == pytest.approx(1.87, abs=0.05)
        assert sonar["R8"] == pytest.approx(1.87, abs=0.05)
        assert sonar["F8"] == pytest.approx(2.87, abs=0.05)
        assert sonar["R1"] == pytest.approx(2.87, abs=0.05)


def test_drive_when_its_line_ends_thrice_moves_the_robot(client: Ap2dx) -> None:
    client.send("DRIVE {Left 2.0} {Right 2.0}")
    before = len(client.scans)
    deadline = Deadline("approach to the wall ahead", DEADLINE_S)
    while not (client.scans[before:] and client.scans[-1][90] < client.scans[before][90] - 0.1):
        deadline.check()
        client.turn()
