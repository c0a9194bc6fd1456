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
from catoptra_protocol.wire.grammar import LineReader, parse_message
from catoptra_protocol.wire.image import ImageFrameReader, ImageType, WireFrame, raw_size
from catoptra_protocol.wire.jpeg import jpeg_size
from conformance.script import WITHIN_S, Address, Conversation, Step, UnexpectedError

_READ_BYTES = 64 * 1024


@dataclass(slots=True)
class Line:
    """One connection, and what of it has not been looked at yet."""

    socket: socket.socket
    lines: deque[str] = field(default_factory=deque)
    frames: deque[WireFrame] = field(default_factory=deque)
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
            raise UnexpectedError("the server closed the connection")
        if self.is_image:
            self.frames.extend(self.frame_reader.receive(data))
        else:
            self.lines.extend(self.line_reader.receive(data))
        return True

    def next_lines(self, within_s: float) -> Iterator[str]:
        """Yield lines until the time is up."""
        deadline_s = time.monotonic() + within_s
        while True:
            while self.lines:
                yield self.lines.popleft()
            if time.monotonic() >= deadline_s or not self.read(deadline_s):
                return


@dataclass(slots=True)
class Stage:
    """Where a conversation stands: its connection, and the words that `$name` stands for."""

    address: Address
    words: dict[str, str]
    is_image: bool
    ends: ExitStack
    line: Line | None = None

    def connected(self) -> Line:
        """Return the connection, made when first needed."""
        if self.line is None:
            connection = socket.create_connection(self.address, timeout=WITHIN_S)
            self.ends.callback(connection.close)
            self.line = Line(connection, is_image=self.is_image)
        return self.line


def hold(conversation: Conversation, address: Address, words: dict[str, str]) -> str:
    """Hold the conversation; return an empty text, or what went wrong and at which step."""
    with ExitStack() as ends:
        stage = Stage(address, dict(words), conversation.port == "image", ends)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - SETTINGS:
                    STEPS[key](stage, step)
            except (UnexpectedError, CatoptraError, OSError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _send(stage: Stage, step: Step) -> None:
    """`send`: text; or `send_hex`: bytes. `repeat` times, with `pieces` so many bytes at a time."""
    text = Template(step.get("send", "")).safe_substitute(stage.words)
    data = bytes.fromhex(step["send_hex"]) if "send_hex" in step else text.encode("latin-1")
    data *= step.get("repeat", 1)
    size = step.get("pieces", len(data))
    line = stage.connected()
    line.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for start in range(0, len(data), size):
        line.socket.sendall(data[start : start + size])


def _expect(stage: Stage, step: Step) -> None:
    """`expect`: patterns of whole lines, in this order, other lines between them."""
    for pattern in step["expect"]:
        filled = Template(pattern).safe_substitute(stage.words)
        _wait(stage.connected(), filled, step.get("within_s", WITHIN_S))


def _silence(stage: Stage, step: Step) -> None:
    """`silence`: a pattern that no line matches for `for_s` seconds."""
    for text in stage.connected().next_lines(step["for_s"]):
        if re.fullmatch(step["silence"], text):
            raise UnexpectedError(f"{text[:100]!r} was not to come")


def _changes(stage: Stage, step: Step) -> None:
    """`changes`: a pattern with one group, a number that grows by more than `by`."""
    line, first = stage.connected(), None
    for text in line.next_lines(step.get("within_s", WITHIN_S)):
        if found := re.fullmatch(step["changes"], text):
            first = float(found[1]) if first is None else first
            if float(found[1]) - first > step["by"]:
                return
    raise UnexpectedError(f"{step['changes']} did not grow by {step['by']} from {first}")


def _ask_every_sensor(stage: Stage, step: Step) -> None:
    """`ask_every_sensor`: each that is heard of for `for_s` seconds has its CONF and GEO."""
    line = stage.connected()
    heard = {pair for text in line.next_lines(step["for_s"]) for pair in _parts(text)}
    if not heard:
        raise UnexpectedError("no sensor was heard of")
    for type_, name in sorted(heard):
        for word in ("CONF", "GEO"):
            line.socket.sendall(f"GET{word} {{Type {type_}}} {{Name {name}}}\r\n".encode())
            pattern = rf"{word} {{Type {type_}}} {{Name {name}\b.+"
            _wait(line, f"(?i:{pattern})", WITHIN_S)


def _frames(stage: Stage, step: Step) -> None:
    """`frames`: so many come, each a picture; with `size`, of that width and height."""
    line, deadline_s = stage.connected(), time.monotonic() + step.get("within_s", WITHIN_S)
    for number in range(step["frames"]):
        while not line.frames:
            if time.monotonic() >= deadline_s or not line.read(deadline_s):
                raise UnexpectedError(f"{number} frames came of {step['frames']}")
        frame = line.frames.popleft()
        is_raw = frame.image_type is ImageType.RAW
        size = list(raw_size(frame.payload)[:2] if is_raw else jpeg_size(frame.payload))
        if size != step.get("size", size):
            raise UnexpectedError(f"a frame of {size}, not {step['size']}")


def _no_frame(stage: Stage, step: Step) -> None:
    """`no_frame_for_s`: nothing comes for so long."""
    line = stage.connected()
    if line.frames or line.read(time.monotonic() + step["no_frame_for_s"]):
        raise UnexpectedError("a frame came that nobody asked for")


def _close(stage: Stage, step: Step) -> None:
    """`close`: end the connection; the next step makes another."""
    stage.connected().socket.close()
    stage.line = None


def _reset(stage: Stage, step: Step) -> None:
    """`reset`: break the connection off with RST, as a client that dies with unread bytes."""
    at_once = struct.pack("ii", 1, 0)
    stage.connected().socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, at_once)
    _close(stage, step)


def _wait(line: Line, pattern: str, within_s: float) -> None:
    for text in line.next_lines(within_s):
        if re.fullmatch(pattern, text):
            return
    raise UnexpectedError(f"nothing like {pattern} came within {within_s:g} s")


def _parts(text: str) -> Iterator[tuple[str, str]]:
    """Yield type and name of each part that a report speaks of."""
    message = parse_message(text)
    type_ = message.get("Type") if message.word == "SEN" else "MisPkg"
    if message.word in ("SEN", "MISSTA", "ASTA") and type_:
        names = (value.split(" ")[0] for key, value in message.pairs if key.lower() == "name")
        yield from ((type_, name) for name in names)


STEPS: dict[str, Callable[[Stage, Step], None]] = {
    "send": _send,
    "send_hex": _send,
    "expect": _expect,
    "silence": _silence,
    "changes": _changes,
    "ask_every_sensor": _ask_every_sensor,
    "frames": _frames,
    "no_frame_for_s": _no_frame,
    "close": _close,
    "reset": _reset,
}
SETTINGS = {"pieces", "within_s", "for_s", "by", "size", "repeat"}
