"""AP2DX, maldo's Java client: a reader that eats bytes, and a parser that counts blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from helpers.legacy_sockets import connect, receive
from helpers.server_process import RunningServer

_BUFFER_BYTES = 8192  # of a BufferedReader


@dataclass
class Ap2dx:
    """One robot, and what was understood of it.

    Each turn reads one raw byte past the buffer and throws it away, then a whole line from the
    buffer: so the first letters of whatever stands at the head of the socket get lost. Lines are
    cut at "} {", and their pieces are known by their places. How the program tells one damaged line
    from another is not known; here a line is of the type that its second piece names.
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
        """End the connection."""
        self._connection.close()

    def send(self, text: str) -> None:
        """Send a line as the program does under Linux, whose println adds a LF of its own."""
        self._connection.sendall(text.encode() + b"\r\n\n")

    def turn(self) -> None:
        """Eat a byte, read a line, understand it."""
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
        """Read whole numbers by their places, as Integer.parseInt would; it dies on others."""
        values = [piece.strip("{}").split(" ")[1] for piece in pieces]
        light, battery, view = (int(values[place]) for place in (5, 6, 7))
        self.status.append((light, battery, view))

    def _read_sonars(self, pieces: list[str]) -> None:
        words = [piece.strip("{}").split(" ") for piece in pieces]
        found = {word[1]: float(word[3]) for word in words}
        assert len(found) == 16, "its arrays have 16 places"
        self.sonars.append(found)


@pytest.fixture
def client(server: RunningServer):
    """Yield a client whose robot stands in the room, after 60 lines."""
    client = Ap2dx(server.control_port)
    client.send("INIT {ClassName USARBot.P2AT} {Location 0.0 0.0 0.0} {Name AP2DX}")
    while len(client.lines) < 60:
        client.turn()
    yield client
    client.close()


def test_greeting_when_its_first_byte_is_eaten_is_damaged_and_nothing_else_is(
    client: Ap2dx,
) -> None:
    assert client.lines[0].startswith("FO {Gametype ")
    intact = [line for line in client.lines if line.startswith(("SEN {", "STA {", "MISSTA {"))]
    # A cycle is 13 lines in one piece: one of them is damaged, the first.
    assert len(intact) >= 0.8 * len(client.lines)


def test_cycle_when_read_by_places_is_understood(client: Ap2dx) -> None:
    assert len(client.status) >= 3
    assert {light for light, _, _ in client.status} == {0}
    assert all(1190 <= battery <= 1200 for _, battery, _ in client.status)
    assert {view for _, _, view in client.status} == {-1}
    assert client.scans
    assert {len(scan) for scan in client.scans} == {181}


def test_sonars_when_in_one_line_are_all_sixteen_and_on_their_sides(client: Ap2dx) -> None:
    assert client.sonars
    for sonar in client.sonars:
        # F1 and R8 look left at 2 m, F8 and R1 right at 3 m; each sits 0.13 m off the middle.
        assert sonar["F1"] == pytest.approx(1.87, abs=0.05)
        assert sonar["R8"] == pytest.approx(1.87, abs=0.05)
        assert sonar["F8"] == pytest.approx(2.87, abs=0.05)
        assert sonar["R1"] == pytest.approx(2.87, abs=0.05)


def test_drive_when_its_line_ends_thrice_moves_the_robot(client: Ap2dx) -> None:
    client.send("DRIVE {Left 2.0} {Right 2.0}")
    before = len(client.scans)
    while not (client.scans[before:] and client.scans[-1][90] < client.scans[before][90] - 0.1):
        client.turn()
