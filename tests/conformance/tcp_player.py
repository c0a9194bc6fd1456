"""Player of the conversations on the control and image ports.

The key of a step selects its handler in STEP_HANDLERS; the handler's docstring documents the step.
Lines of the server that a step does not wait for are skipped, since reports arrive at any time.
Blocking sockets, one at a time.

To add a step: its handler and its entry in STEP_HANDLERS, its options in STEP_OPTIONS.
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
    parse_jpeg_size,
    parse_raw_size,
)
from conformance.check import rejection_of_recording
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
    """One connection, and the lines and frames that no step has consumed yet."""

    socket: socket.socket
    lines: deque[str] = field(default_factory=deque)
    frames: deque[EncodedFrame] = field(default_factory=deque)
    line_reader: LineReader = field(default_factory=LineReader)
    frame_reader: ImageFrameReader = field(default_factory=ImageFrameReader)
    is_image: bool = False

    def read(self, deadline_s: float) -> bool:
        """Receive bytes of the server; False if none arrived before the deadline."""
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
        """Iterate over lines until the timeout."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            while self.lines:
                text = self.lines.popleft()
                if reason := rejection_of_recording(text):
                    raise StepFailedError(reason)
                yield text
            if time.monotonic() >= deadline_s or not self.read(deadline_s):
                return


@dataclass(slots=True)
class TcpSession:
    """State of a conversation in progress."""

    address: Address
    variables: dict[str, str]
    """Text of each `$name`."""
    is_image: bool
    exit_stack: ExitStack
    connection: TcpConnection | None = None

    def connect(self) -> TcpConnection:
        """Current connection, opened on first use."""
        if self.connection is None:
            connection = socket.create_connection(self.address, timeout=TIMEOUT_S)
            self.exit_stack.callback(connection.close)
            self.connection = TcpConnection(connection, is_image=self.is_image)
        return self.connection


def play_conversation(
    conversation: Conversation, address: Address, variables: dict[str, str]
) -> str:
    """Play a conversation; empty if passed, else the failed step and the reason."""
    with ExitStack() as exit_stack:
        session = TcpSession(address, dict(variables), conversation.port == "image", exit_stack)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - STEP_OPTIONS:
                    STEP_HANDLERS[key](session, step)
            except (StepFailedError, CatoptraError, OSError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _send(session: TcpSession, step: StepSpec) -> None:
    """`send`: text, or `send_hex`: bytes. Sent `repeat` times, in pieces of `pieces` bytes."""
    text = Template(step.get("send", "")).safe_substitute(session.variables)
    data = bytes.fromhex(step["send_hex"]) if "send_hex" in step else text.encode("latin-1")
    data *= step.get("repeat", 1)
    size = step.get("pieces", len(data))
    connection = session.connect()
    # Without Nagle's algorithm each piece is a segment of its own.
    connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for start in range(0, len(data), size):
        connection.socket.sendall(data[start : start + size])


def _expect(session: TcpSession, step: StepSpec) -> None:
    """`expect`: patterns of full lines, in this order, other lines between them."""
    for pattern in step["expect"]:
        filled = Template(pattern).safe_substitute(session.variables)
        _wait_for_line(session.connect(), filled, step.get("timeout_s", TIMEOUT_S))


def _expect_silence(session: TcpSession, step: StepSpec) -> None:
    """`silence`: a pattern that no line matches for `duration_s` seconds."""
    for text in session.connect().iter_lines(step["duration_s"]):
        if re.fullmatch(step["silence"], text):
            raise StepFailedError(f"{text[:100]!r} was not expected")


def _expect_increase(session: TcpSession, step: StepSpec) -> None:
    """`increases`: a pattern with one group, a number that grows by more than `min_increase`."""
    first = None
    for text in session.connect().iter_lines(step.get("timeout_s", TIMEOUT_S)):
        if found := re.fullmatch(step["increases"], text):
            first = float(found[1]) if first is None else first
            if float(found[1]) - first > step["min_increase"]:
                return
    raise StepFailedError(
        f"{step['increases']} did not increase by {step['min_increase']} from {first}"
    )


def _query_every_sensor(session: TcpSession, step: StepSpec) -> None:
    """`query_every_sensor`: each sensor that reports for `duration_s` seconds has CONF and GEO."""
    connection = session.connect()
    lines = connection.iter_lines(step["duration_s"])
    sensors = {pair for text in lines for pair in _sensor_names(text)}
    if not sensors:
        raise StepFailedError("no sensor reported")
    for type_, name in sorted(sensors):
        for word in ("CONF", "GEO"):
            connection.socket.sendall(f"GET{word} {{Type {type_}}} {{Name {name}}}\r\n".encode())
            # In any case: the reference repeats the type of the request, other servers their own
            # spelling.
            pattern = rf"{word} {{Type {type_}}} {{Name {name}\b.+"
            _wait_for_line(connection, f"(?i:{pattern})", TIMEOUT_S)


def _expect_frames(session: TcpSession, step: StepSpec) -> None:
    """`frames`: number of decodable frames; with `size`, of that width and height."""
    connection = session.connect()
    deadline_s = time.monotonic() + step.get("timeout_s", TIMEOUT_S)
    for number in range(step["frames"]):
        while not connection.frames:
            if time.monotonic() >= deadline_s or not connection.read(deadline_s):
                raise StepFailedError(f"{number} of {step['frames']} frames arrived")
        frame = connection.frames.popleft()
        is_raw = frame.image_type is ImageType.RAW
        size = list(parse_raw_size(frame.payload)[:2] if is_raw else parse_jpeg_size(frame.payload))
        if size != step.get("size", size):
            raise StepFailedError(f"a frame of {size}, not {step['size']}")


def _expect_no_frame(session: TcpSession, step: StepSpec) -> None:
    """`no_frame_for_s`: no frame arrives for this time."""
    connection = session.connect()
    if connection.frames or connection.read(time.monotonic() + step["no_frame_for_s"]):
        raise StepFailedError("a frame arrived without a request")


def _close_connection(session: TcpSession, step: StepSpec) -> None:
    """`close`: end the connection; the next step opens another."""
    session.connect().socket.close()
    session.connection = None


def _reset_connection(session: TcpSession, step: StepSpec) -> None:
    """`reset`: end the connection with RST, as a client that dies with unread bytes."""
    no_linger = struct.pack("ii", 1, 0)
    session.connect().socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, no_linger)
    _close_connection(session, step)


def _wait_for_line(connection: TcpConnection, pattern: str, timeout_s: float) -> None:
    for text in connection.iter_lines(timeout_s):
        if re.fullmatch(pattern, text):
            return
    raise StepFailedError(f"no line {pattern} within {timeout_s:g} s")


def _sensor_names(text: str) -> Iterator[tuple[str, str]]:
    """Type and name of each part in a report."""
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
    "increases": _expect_increase,
    "query_every_sensor": _query_every_sensor,
    "frames": _expect_frames,
    "no_frame_for_s": _expect_no_frame,
    "close": _close_connection,
    "reset": _reset_connection,
}
STEP_OPTIONS = {"pieces", "timeout_s", "duration_s", "min_increase", "size", "repeat"}
