"""Who is at the live server: a guest that behaves, and strangers that send what they like.

All on one asyncio loop. The guest and the strangers never speak to each other but through the
server.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
import time
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any

import zmq
import zmq.asyncio

from catoptra_client.frame import rgb_from_file
from catoptra_protocol.wire.commands import Init
from catoptra_protocol.wire.connection import ControlClient
from catoptra_protocol.wire.image import ImageFrameReader, image_request
from catoptra_protocol.wire.reports import OdometryReading, VehicleStatus
from catoptra_protocol.wire.stream import answer_from_bytes, bytes_from_message
from catoptra_protocol.wire.stream_answers import FrameHeader
from catoptra_protocol.wire.stream_requests import AskFrame, Encoding
from conformance.fuzz_parser import DATA, mutated, seeds
from conformance.fuzz_stream import mutated_message
from helpers.server_process import RunningServer

HOST = "127.0.0.1"
_STRANGERS_A_PORT = 4
_BURST = 20  # cases a write
# Between bursts: the guest's own machine has to run, too.
_PAUSE_S = 0.05
# Until a stranger comes again. Some are cut off by the server, some leave by themselves.
_BURSTS_A_VISIT = 30
_HUGE = (b"x" * 200_000, b"{" * 70_000, b"U" * 70_000, b"OK" * 20_000, bytes(70_000))

Play = Coroutine[Any, Any, None]


@dataclass
class Tally:
    """What the guest saw: when its status came, how many frames, what was wrong."""

    status_s: list[float] = field(default_factory=list)
    tcp_frames: int = 0
    stream_frames: int = 0
    faults: list[str] = field(default_factory=list)


@dataclass
class Guest:
    """One robot that stands still, and its pictures over both transports."""

    server: RunningServer
    saw: Tally = field(default_factory=Tally)
    _context: zmq.asyncio.Context = field(default_factory=zmq.asyncio.Context)

    def plays(self) -> list[Play]:
        """Return what it does at the same time, for ever."""
        return [self._stand(), self._look(), self._look_at_stream()]

    def close(self) -> None:
        """End what does not end by itself."""
        self._context.destroy(linger=0)

    async def _stand(self) -> None:
        reader, writer = await asyncio.open_connection(HOST, self.server.control_port)
        protocol = ControlClient()
        writer.write(protocol.send(Init("USARBot.OmniP2AT", "Guest", (0.0, 0.0, 0.0))))
        with contextlib.closing(writer):
            while data := await reader.read(65536):
                for report in protocol.receive(data):
                    if isinstance(report, VehicleStatus):
                        self.saw.status_s.append(time.monotonic())
                    elif isinstance(report, OdometryReading):
                        moved = (report.x_m, report.y_m, report.yaw_rad)
                        self._check(not any(moved), f"somebody else's DRIVE moved it: {moved}")
        self.saw.faults.append("cut off from its robot")

    async def _look(self) -> None:
        reader, writer = await asyncio.open_connection(HOST, self.server.image_port)
        frames = ImageFrameReader()
        writer.write(image_request())
        with contextlib.closing(writer):
            while data := await reader.read(1 << 18):
                for frame in frames.receive(data):
                    self._check(rgb_from_file(frame.payload).shape == (64, 64, 3), "a TCP frame")
                    self.saw.tcp_frames += 1
                    await asyncio.sleep(_PAUSE_S)
                    writer.write(image_request())
        self.saw.faults.append("cut off from its pictures")

    async def _look_at_stream(self) -> None:
        socket = self._context.socket(zmq.DEALER)
        socket.connect(f"tcp://{HOST}:{self.server.stream_port}")
        sequence, time_s = 0, 0.0
        for id_ in itertools.count(1):
            await socket.send(bytes_from_message(AskFrame(id_, "", "", Encoding.RAW)))
            header = await self._frame(socket)
            self._check(header.id == id_, f"frame {header.id} for request {id_}")
            self._check(header.sequence > sequence, f"frame {header.sequence} after {sequence}")
            self._check(header.time_s >= time_s, f"time {header.time_s} after {time_s}")
            sequence, time_s = header.sequence, header.time_s
            self.saw.stream_frames += 1
            await asyncio.sleep(_PAUSE_S)

    async def _frame(self, socket: zmq.asyncio.Socket) -> FrameHeader:
        while True:
            head, *rest = await socket.recv_multipart()
            answer = answer_from_bytes(head)
            if isinstance(answer, FrameHeader):
                self._check([len(part) for part in rest] == [64 * 64 * 3], "a stream's picture")
                return answer
            self._check(answer is not None and answer.KIND == "pulse", f"unasked: {answer}")

    def _check(self, is_so: bool, otherwise: str) -> None:
        if not is_so:
            self.saw.faults.append(otherwise)


@dataclass
class Strangers:
    """Those who send garbage, on bare TCP to all ports and as messages to the stream."""

    server: RunningServer
    seed: int
    connections: int = 0
    sent_bytes: int = 0
    _context: zmq.asyncio.Context = field(default_factory=zmq.asyncio.Context)

    def plays(self) -> list[Play]:
        """Return what they do at the same time, for ever."""
        control = (
            *seeds("commands"),
            *seeds("sessions"),
            b"INIT {ClassName OmniP2AT} {Location 1,1,0}\r\n" * 3,
        )
        messages = tuple(path.read_bytes() for path in sorted((DATA / "stream").glob("*.bytes")))
        # A ZMTP greeting, and the READY command of a DEALER.
        zmtp = (b"\xff" + bytes(8) + b"\x7f\x03\0NULL" + bytes(48), b"\4\x26\5READY\x0bSocket-Type")
        ports = (
            (self.server.control_port, control),
            (self.server.image_port, seeds("image_requests")),
            (self.server.stream_port, (*zmtp, *messages)),
        )
        return [
            *(
                self._send_bytes(random.Random(f"{self.seed} {port} {number}"), port, given)
                for port, given in ports
                for number in range(_STRANGERS_A_PORT)
            ),
            *(
                self._send_messages(random.Random(f"{self.seed} {number}"), messages)
                for number in range(_STRANGERS_A_PORT)
            ),
        ]

    def close(self) -> None:
        """End what does not end by itself."""
        self._context.destroy(linger=0)

    async def _send_bytes(self, chance: random.Random, port: int, given: tuple[bytes, ...]) -> None:
        """Connect, send, sometimes read, leave in one way or the other; and again."""
        while True:
            with contextlib.suppress(ConnectionError):
                reader, writer = await asyncio.open_connection(HOST, port)
                self.connections += 1
                await self._visit(chance, reader, writer, given)
            await asyncio.sleep(_PAUSE_S)

    async def _visit(
        self,
        chance: random.Random,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        given: tuple[bytes, ...],
    ) -> None:
        try:
            for _ in range(chance.randrange(_BURSTS_A_VISIT)):
                data = b"".join(mutated(chance, given) for _ in range(_BURST))
                data = chance.choice(_HUGE) if chance.random() < 0.02 else data
                writer.write(data)
                self.sent_bytes += len(data)
                # Who does not read its answers must be a trouble to nobody but itself.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(writer.drain(), 1.0)
                if chance.random() < 0.5:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(65536), _PAUSE_S)
                await asyncio.sleep(_PAUSE_S)
        finally:
            writer.transport.abort()

    async def _send_messages(self, chance: random.Random, given: tuple[bytes, ...]) -> None:
        """Send whole messages of one to three parts to the stream, and come anew now and then."""
        while True:
            socket = self._context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.connect(f"tcp://{HOST}:{self.server.stream_port}")
            self.connections += 1
            for _ in range(chance.randrange(_BURSTS_A_VISIT)):
                for _ in range(_BURST):
                    await self._send_message(chance, socket, given)
                await asyncio.sleep(_PAUSE_S)
            socket.close()

    async def _send_message(
        self, chance: random.Random, socket: zmq.asyncio.Socket, given: tuple[bytes, ...]
    ) -> None:
        count = 1 if chance.random() < 0.8 else chance.randrange(1, 4)
        parts = [mutated_message(chance, given) for _ in range(count)]
        with contextlib.suppress(zmq.Again):
            await socket.send_multipart(parts, flags=zmq.NOBLOCK)
            self.sent_bytes += sum(map(len, parts))
