"""Hold a conversation on the control or image port as a data file tells.

What each step holds is told at its function below. Lines of the server that a step does not wait
for are skipped, since reports come at any time. Blocking sockets, one at a time.
"""

from __future__ import annotations

import re
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from string import Template

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.usarsim.grammar import LineReader, parse_message
from catoptra_protocol.usarsim.image_port import (
    EncodedFrame,
    ImageFrameReader,
    ImageType,
    parse_raw_size,
)
from catoptra_protocol.usarsim.jpeg_header import parse_jpeg_size
from conformance.conversation_file import (
    TIMEOUT_S,
    Address,
    Conversation,
    StepFailedError,
    StepSpec,
)

_READ_BYTES = 64 * 1024


@dataclass(slots=True)
class TcpConnection:
    """One connection, and what of it has not been looked at yet."""

    socket: socket.socket
    lines: deque[str] = field(default_factory=deque)
    frames: deque[EncodedFrame] = field(default_factory=deque)
    line_reader: LineReader = field(default_factory=LineReader)
    frame_reader: ImageFrameReader = field(default_factory=ImageFrameReader)
    is_image: bool = False

    def read(self, deadline_s: float) -> bool:
        """Take in what the server sent; return whether anything came before the deadline."""
        self.socket.settimeout(max(deadline_s - time.monotonic(), 1e-3))
        try:
            data = self.socket.recv(_READ_BYTES)
        except TimeoutError:
            return False
        if not data:
            raise StepFailedError("the server closed the connection")
        if self.is_image:
            self.frames.extend(self.frame_reader.receive(data))
        else:
            self.lines.extend(self.line_reader.receive(data))
        return True

    def iter_lines(self, timeout_s: float) -> Iterator[str]:
        """Yield lines until the time is up."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            while self.lines:
                yield self.lines.popleft()
            if time.monotonic() >= deadline_s or not self.read(deadline_s):
                return


@dataclass(slots=True)
class TcpSession:
    """Where a conversation stands: its connection, and the words that `$name` stands for."""

    address: Address
    variables: dict[str, str]
    is_image: bool
    exit_stack: ExitStack
    connection: TcpConnection | None = None

    def connect(self) -> TcpConnection:
        """Return the connection, made when first needed."""
        if self.connection is None:
            connection = socket.create_connection(self.address, timeout=TIMEOUT_S)
            self.exit_stack.callback(connection.close)
            self.connection = TcpConnection(connection, is_image=self.is_image)
        return self.connection


def play_conversation(
    conversation: Conversation, address: Address, variables: dict[str, str]
) -> str:
    """Hold the conversation; return an empty text, or what went wrong and at which step."""
    with ExitStack() as ends:
        stage = TcpSession(address, dict(variables), conversation.port == "image", ends)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - STEP_OPTIONS:
                    STEP_HANDLERS[key](stage, step)
            except (StepFailedError, CatoptraError, OSError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _send(session: TcpSession, step: StepSpec) -> None:
    """`send`: text; or `send_hex`: bytes. `repeat` times, with `pieces` so many bytes at a time."""
    text = Template(step.get("send", "")).safe_substitute(session.variables)
    data = bytes.fromhex(step["send_hex"]) if "send_hex" in step else text.encode("latin-1")
    data *= step.get("repeat", 1)
    size = step.get("pieces", len(data))
    line = session.connect()
    line.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for start in range(0, len(data), size):
        line.socket.sendall(data[start : start + size])


def _expect(session: TcpSession, step: StepSpec) -> None:
    """`expect`: patterns of whole lines, in this order, other lines between them."""
    for pattern in step["expect"]:
        filled = Template(pattern).safe_substitute(session.variables)
        _wait_for_line(session.connect(), filled, step.get("within_s", TIMEOUT_S))


def _expect_silence(session: TcpSession, step: StepSpec) -> None:
    """`silence`: a pattern that no line matches for `for_s` seconds."""
    for text in session.connect().iter_lines(step["for_s"]):
        if re.fullmatch(step["silence"], text):
            raise StepFailedError(f"{text[:100]!r} was not to come")


def _expect_increase(session: TcpSession, step: StepSpec) -> None:
    """`changes`: a pattern with one group, a number that grows by more than `by`."""
    line, first = session.connect(), None
    for text in line.iter_lines(step.get("within_s", TIMEOUT_S)):
        if found := re.fullmatch(step["changes"], text):
            first = float(found[1]) if first is None else first
            if float(found[1]) - first > step["by"]:
                return
    raise StepFailedError(f"{step['changes']} did not grow by {step['by']} from {first}")


def _query_every_sensor(session: TcpSession, step: StepSpec) -> None:
    """`ask_every_sensor`: each that is heard of for `for_s` seconds has its CONF and GEO."""
    line = session.connect()
    heard = {pair for text in line.iter_lines(step["for_s"]) for pair in _sensor_names(text)}
    if not heard:
        raise StepFailedError("no sensor was heard of")
    for type_, name in sorted(heard):
        for word in ("CONF", "GEO"):
            line.socket.sendall(f"GET{word} {{Type {type_}}} {{Name {name}}}\r\n".encode())
            pattern = rf"{word} {{Type {type_}}} {{Name {name}\b.+"
            _wait_for_line(line, f"(?i:{pattern})", TIMEOUT_S)


def _expect_frames(session: TcpSession, step: StepSpec) -> None:
    """`frames`: so many come, each a picture; with `size`, of that width and height."""
    line, deadline_s = session.connect(), time.monotonic() + step.get("within_s", TIMEOUT_S)
    for number in range(step["frames"]):
        while not line.frames:
            if time.monotonic() >= deadline_s or not line.read(deadline_s):
                raise StepFailedError(f"{number} frames came of {step['frames']}")
        frame = line.frames.popleft()
        is_raw = frame.image_type is ImageType.RAW
        size = list(parse_raw_size(frame.payload)[:2] if is_raw else parse_jpeg_size(frame.payload))
        if size != step.get("size", size):
            raise StepFailedError(f"a frame of {size}, not {step['size']}")


def _expect_no_frame(session: TcpSession, step: StepSpec) -> None:
    """`no_frame_for_s`: nothing comes for so long."""
    line = session.connect()
    if line.frames or line.read(time.monotonic() + step["no_frame_for_s"]):
        raise StepFailedError("a frame came that nobody asked for")


def _close_connection(session: TcpSession, step: StepSpec) -> None:
    """`close`: end the connection; the next step makes another."""
    session.connect().socket.close()
    session.connection = None


def _reset_connection(session: TcpSession, step: StepSpec) -> None:
    """`reset`: break the connection off with RST, as a client that dies with unread bytes."""
    at_once = struct.pack("ii", 1, 0)
    session.connect().socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, at_once)
    _close_connection(session, step)


def _wait_for_line(connection: TcpConnection, pattern: str, timeout_s: float) -> None:
    for text in connection.iter_lines(timeout_s):
        if re.fullmatch(pattern, text):
            return
    raise StepFailedError(f"nothing like {pattern} came within {timeout_s:g} s")


def _sensor_names(text: str) -> Iterator[tuple[str, str]]:
    """Yield type and name of each part that a report speaks of."""
    message = parse_message(text)
    type_ = message.get("Type") if message.word == "SEN" else "MisPkg"
    if message.word in ("SEN", "MISSTA", "ASTA") and type_:
        names = (value.split(" ")[0] for key, value in message.pairs if key.lower() == "name")
        yield from ((type_, name) for name in names)


STEP_HANDLERS: dict[str, Callable[[TcpSession, StepSpec], None]] = {
    "send": _send,
    "send_hex": _send,
    "expect": _expect,
    "silence": _expect_silence,
    "changes": _expect_increase,
    "ask_every_sensor": _query_every_sensor,
    "frames": _expect_frames,
    "no_frame_for_s": _expect_no_frame,
    "close": _close_connection,
    "reset": _reset_connection,
}
STEP_OPTIONS = {"pieces", "within_s", "for_s", "by", "size", "repeat"}
