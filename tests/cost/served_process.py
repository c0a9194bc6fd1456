"""Servers in processes of their own, and clients of their image ports that count frames.

A client takes each frame by one call that waits for all of it, so that the clients leave both
processors to the server as far as possible.
"""

from __future__ import annotations

import json
import mmap
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_client.robot_client import RobotClient
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from cost.counted_server import STAND_IN_OPTION
from helpers.zmtp import LONG, MORE, connect_with_handshake, zmtp_frame

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "configs/robots/p2at_omni.ini"
WORLD = ROOT / "configs/worlds/four_legged_2006.ini"
HOST = "127.0.0.1"
FULL_REQUEST = b"OK"
HEADER_BYTES = 5
MAX_PAYLOAD_BYTES = 32 * 2**20
TIMEOUT_S = 120.0
SETTLE_S = 0.4
WARM_UP_FRAMES = 3


@dataclass(frozen=True, slots=True)
class Counters:
    """What the server has counted so far."""

    time_s: float
    frames: int
    process_s: float
    serving_s: float


@dataclass(frozen=True, slots=True)
class Window:
    """Counts of some time."""

    elapsed_s: float
    drawn: int
    delivered: tuple[int, ...]
    """Frames of each client."""
    process_s: float
    """Processor time of the server."""
    serving_s: float
    """Processor time of the threads that do not only draw, without that of drawing."""


class Watcher:
    """A client that requests frame after frame while it is active."""

    def __init__(self, port: int, *, request: bytes = FULL_REQUEST, rate_hz: float = 0.0) -> None:
        """Connect.

        Args:
            port: Image port.
            request: Bytes of each request.
            rate_hz: Frames per second at most; 0 sets no limit.
        """
        self.num_frames = 0
        self.payload = memoryview(b"")
        """The newest frame's, until the next one arrives."""
        self._request = request
        self._interval_s = 1.0 / rate_hz if rate_hz else 0.0
        self._socket = self._connect(port)
        # Not `settimeout`: Python's time-outs make a socket that never waits for all bytes.
        timeout = struct.pack("ll", int(TIMEOUT_S), 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Not a bytearray, whose zeros take 20 ms of the time to the first frame.
        self._buffer = mmap.mmap(-1, MAX_PAYLOAD_BYTES)
        self._active = threading.Event()
        self._has_ended = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _connect(self, port: int) -> socket.socket:
        return socket.create_connection((HOST, port))

    def _make_request(self) -> bytes:
        return self._request

    def set_active(self, is_active: bool) -> None:
        """Start or pause the requests."""
        (self._active.set if is_active else self._active.clear)()

    def close(self) -> None:
        """End the client."""
        self._has_ended = True
        self._active.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        due_s = time.monotonic()
        while True:
            self._active.wait()
            if self._has_ended:
                return
            if self._interval_s:
                # A client that was late catches up with no burst.
                due_s = max(due_s + self._interval_s, time.monotonic() - self._interval_s)
                time.sleep(max(0.0, due_s - time.monotonic()))
            self.receive_frame()

    def receive_frame(self) -> None:
        """Request and receive one frame."""
        self._socket.sendall(self._make_request())
        length = struct.unpack(">BI", self._receive(HEADER_BYTES))[1]
        self.payload = self._receive(length)
        self.num_frames += 1

    def _receive(self, length: int) -> memoryview:
        """The next bytes, all of them; valid until the next call."""
        view = memoryview(self._buffer)[:length]
        received = self._socket.recv_into(view, length, socket.MSG_WAITALL)
        if received != length:
            raise ConnectionError(f"the server ended the connection after {received} bytes")
        return view


def make_stream_request(id_: int, encoding: ImageEncoding = ImageEncoding.RAW) -> bytes:
    """Bytes of a DEALER that requests the image port's picture."""
    return zmtp_frame(bytes_from_message(GetFrameRequest(id_, "", "", encoding)), LONG)


class StreamWatcher(Watcher):
    """The same of the stream: a DEALER without ZeroMQ, which would take a processor of its own."""

    def _make_request(self) -> bytes:
        # The server takes a second request of one id for a repeat.
        return make_stream_request(self.num_frames + 1, ImageEncoding(self._request.decode()))

    def _connect(self, port: int) -> socket.socket:
        connected = connect_with_handshake(port)
        connected.settimeout(None)
        return connected

    def receive_frame(self) -> None:
        """Request and receive one frame, among heartbeats."""
        self._socket.sendall(self._make_request())
        while self._receive_message() == 1:
            pass
        self.num_frames += 1

    def _receive_message(self) -> int:
        """Receive a message; its number of parts."""
        flags, num_parts = MORE, 0
        while flags & MORE:
            flags, short = struct.unpack("BB", self._receive(2))
            rest = bytes(self._receive(7)) if flags & LONG else b""
            self.payload = self._receive(int.from_bytes(bytes((short,)) + rest, "big"))
            num_parts += 1
        return num_parts


class CountedServer:
    """A server process with counters."""

    def __init__(self, process: subprocess.Popen[str], ports: Sequence[int]) -> None:
        self._process = process
        self.control_port, self.image_port, self.stream_port = ports

    @property
    def resident_mb(self) -> float:
        """Resident memory."""
        status = Path(f"/proc/{self._process.pid}/status").read_text()
        return int(re.findall(r"VmRSS:\s+(\d+)", status)[0]) / 1000.0

    def read_counters(self) -> Counters:
        """Read the present counts."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return Counters(**json.loads(self._process.stdout.readline()))

    def warm_up(self, watchers: Sequence[Watcher]) -> None:
        """Wait until each client has some frames: views are prepared at their first use."""
        enough = [watcher.num_frames + WARM_UP_FRAMES for watcher in watchers]
        for watcher in watchers:
            watcher.set_active(True)
        until_s = time.monotonic() + TIMEOUT_S
        while any(w.num_frames < count for w, count in zip(watchers, enough, strict=True)):
            assert time.monotonic() < until_s, "a client waits for its frames"
            time.sleep(0.02)
        for watcher in watchers:
            watcher.set_active(False)

    def measure(
        self, watchers: Sequence[Watcher], seconds: float, *, settle_s: float = SETTLE_S
    ) -> Window:
        """Count for some time in which these clients are active.

        Args:
            watchers: The clients; all others pause.
            seconds: Time to count.
            settle_s: Time before, in which the others have their last frames.
        """
        for watcher in watchers:
            watcher.set_active(True)
        time.sleep(settle_s)
        before, begin = self.read_counters(), [watcher.num_frames for watcher in watchers]
        time.sleep(seconds)
        after, end = self.read_counters(), [watcher.num_frames for watcher in watchers]
        for watcher in watchers:
            watcher.set_active(False)
        return Window(
            after.time_s - before.time_s,
            after.frames - before.frames,
            tuple(last - first for first, last in zip(begin, end, strict=True)),
            after.process_s - before.process_s,
            after.serving_s - before.serving_s,
        )


@contextmanager
def start_server(
    *options: str, size_px: int = 640, samples: int = 1, stand_in_ms: float | None = None
) -> Iterator[CountedServer]:
    """Start a counted server of RAW images in the field."""
    stand_in = [] if stand_in_ms is None else [STAND_IN_OPTION, str(stand_in_ms)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        robot = folder / "robot.ini"
        robot.write_text(
            f"[Configuration]\nBasedOn={ROBOT}\n[Catoptra.OmniCaptureCamera]\n"
            f"ResolutionX={size_px}\nResolutionY={size_px}\nSamples={samples}\n"
        )
        command = [sys.executable, "-m", "cost.counted_server", *stand_in]
        process = stack.enter_context(start_process(command, *options, robot=robot))
        yield CountedServer(process, read_ports(process))


@contextmanager
def start_process(
    command: Sequence[str], *options: str, robot: Path = ROBOT, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """Start a server process on free ports."""
    path = os.pathsep.join(filter(None, (str(ROOT / "tests"), os.environ.get("PYTHONPATH"))))
    files = ("--robot", str(robot), "--world", str(WORLD), "--image-type", "RAW")
    with subprocess.Popen(
        [*command, *files, "--control-port", "0", "--image-port", "0", "--no-view", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": path, **environment},
    ) as process:
        try:
            yield process
        finally:
            process.terminate()


def read_ports(process: subprocess.Popen[str]) -> tuple[int, ...]:
    """Ports of control, images and stream, as the server prints them."""
    assert process.stdout is not None
    found = re.findall(r"=[\d.]+:(\d+)", process.stdout.readline())
    assert len(found) == 3, "the server did not start"
    return tuple(map(int, found))


@contextmanager
def spawn_robots(server: CountedServer, count: int) -> Iterator[None]:
    """Turning robots, a metre apart, in rows of four."""
    with ExitStack() as stack:
        for number in range(count):
            robot = stack.enter_context(RobotClient.connect(port=server.control_port))
            row, column = divmod(number, 4)
            location_m = (0.8 * column - 1.2, 0.8 * row - 1.2, 0.0)
            robot.spawn("USARBot.OmniP2AT", location_m=location_m)
            robot.drive(0.5, -0.5)
        yield


@contextmanager
def connect_watchers(
    server: CountedServer, *requests: bytes, rate_hz: float = 0.0
) -> Iterator[list[Watcher]]:
    """Clients, one a request, none of them active.

    Of the image port, or of the stream where a request is the name of an encoding.
    """
    watchers: list[Watcher] = []
    try:
        for request in requests:
            if request[:1] in (b"O", b"U"):
                watchers.append(Watcher(server.image_port, request=request, rate_hz=rate_hz))
            else:
                watchers.append(StreamWatcher(server.stream_port, request=request, rate_hz=rate_hz))
        yield watchers
    finally:
        for watcher in watchers:
            watcher.close()
