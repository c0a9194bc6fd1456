"""Clients of the server under fuzzing: one reference client, and clients that send malformed input.

All run on one asyncio loop and interact only through the server.
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

from catoptra_client.frame import rgb_from_image_bytes
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import FrameHeader, Heartbeat
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from catoptra_protocol.usarsim.commands import Init
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.image_port import ImageFrameReader, encode_full_frame_request
from catoptra_protocol.usarsim.reports import OdometryReading, VehicleStatus
from conformance.fuzz_stream import mutate_message
from conformance.fuzz_target import DATA, load_seed_corpus, mutate
from helpers.server_process import RunningServer

HOST = "127.0.0.1"
_CLIENTS_PER_PORT = 4
_CASES_PER_BURST = 20
# Between bursts: the reference client runs on the same machine.
_PAUSE_S = 0.05
# Some connections are ended by the server, the others by the client after this many bursts.
_MAX_BURSTS_PER_CONNECTION = 30
_HUGE_INPUTS = (b"x" * 200_000, b"{" * 70_000, b"U" * 70_000, b"OK" * 20_000, bytes(70_000))

ClientTask = Coroutine[Any, Any, None]


@dataclass
class ReferenceClientLog:
    """Observations of the reference client."""

    status_s: list[float] = field(default_factory=list)
    """Arrival time of each status report."""
    tcp_frames: int = 0
    stream_frames: int = 0
    faults: list[str] = field(default_factory=list)
    """Violations of the protocol."""


@dataclass
class ReferenceClient:
    """A robot at rest, with its frames over both transports."""

    server: RunningServer
    log: ReferenceClientLog = field(default_factory=ReferenceClientLog)
    _context: zmq.asyncio.Context = field(default_factory=zmq.asyncio.Context)

    def client_tasks(self) -> list[ClientTask]:
        """Concurrent connections, each endless."""
        return [self._run_control(), self._run_image_port(), self._run_stream()]

    def close(self) -> None:
        """Close the sockets."""
        self._context.destroy(linger=0)

    async def _run_control(self) -> None:
        reader, writer = await asyncio.open_connection(HOST, self.server.control_port)
        protocol = ControlClient()
        writer.write(protocol.send(Init("USARBot.OmniP2AT", "Reference", (0.0, 0.0, 0.0))))
        with contextlib.closing(writer):
            while data := await reader.read(65536):
                for report in protocol.receive(data):
                    if isinstance(report, VehicleStatus):
                        self.log.status_s.append(time.monotonic())
                    elif isinstance(report, OdometryReading):
                        moved = (report.x_m, report.y_m, report.yaw_rad)
                        self._check(
                            not any(moved), f"moved by the DRIVE of another client: {moved}"
                        )
        self.log.faults.append("control connection closed")

    async def _run_image_port(self) -> None:
        reader, writer = await asyncio.open_connection(HOST, self.server.image_port)
        frames = ImageFrameReader()
        writer.write(encode_full_frame_request())
        with contextlib.closing(writer):
            while data := await reader.read(1 << 18):
                for frame in frames.receive(data):
                    self._check(
                        rgb_from_image_bytes(frame.payload).shape == (64, 64, 3), "a TCP frame"
                    )
                    self.log.tcp_frames += 1
                    await asyncio.sleep(_PAUSE_S)
                    writer.write(encode_full_frame_request())
        self.log.faults.append("image connection closed")

    async def _run_stream(self) -> None:
        socket = self._context.socket(zmq.DEALER)
        socket.connect(f"tcp://{HOST}:{self.server.stream_port}")
        sequence, time_s = 0, 0.0
        for id_ in itertools.count(1):
            await socket.send(bytes_from_message(GetFrameRequest(id_, "", "", ImageEncoding.RAW)))
            header = await self._receive_frame(socket)
            self._check(header.id == id_, f"frame {header.id} for request {id_}")
            self._check(header.sequence > sequence, f"frame {header.sequence} after {sequence}")
            self._check(header.time_s >= time_s, f"time {header.time_s} after {time_s}")
            sequence, time_s = header.sequence, header.time_s
            self.log.stream_frames += 1
            await asyncio.sleep(_PAUSE_S)

    async def _receive_frame(self, socket: zmq.asyncio.Socket) -> FrameHeader:
        while True:
            head, *rest = await socket.recv_multipart()
            reply = reply_from_bytes(head)
            if isinstance(reply, FrameHeader):
                self._check([len(part) for part in rest] == [64 * 64 * 3], "a stream image")
                return reply
            self._check(isinstance(reply, Heartbeat), f"unsolicited: {reply}")

    def _check(self, condition: bool, message: str) -> None:
        if not condition:
            self.log.faults.append(message)


@dataclass
class MalformedClients:
    """Clients that send garbage: bare TCP to all ports, and messages to the stream."""

    server: RunningServer
    seed: int
    num_connections: int = 0
    sent_bytes: int = 0
    _context: zmq.asyncio.Context = field(default_factory=zmq.asyncio.Context)

    def client_tasks(self) -> list[ClientTask]:
        """Concurrent clients, each endless."""
        control = (
            *load_seed_corpus("commands"),
            *load_seed_corpus("sessions"),
            b"INIT {ClassName OmniP2AT} {Location 1,1,0}\r\n" * 3,
        )
        messages = tuple(path.read_bytes() for path in sorted((DATA / "stream").glob("*.bytes")))
        # A ZMTP greeting, and the READY command of a DEALER.
        zmtp = (b"\xff" + bytes(8) + b"\x7f\x03\0NULL" + bytes(48), b"\4\x26\5READY\x0bSocket-Type")
        ports = (
            (self.server.control_port, control),
            (self.server.image_port, load_seed_corpus("image_requests")),
            (self.server.stream_port, (*zmtp, *messages)),
        )
        return [
            *(
                self._send_bytes(random.Random(f"{self.seed} {port} {number}"), port, corpus)
                for port, corpus in ports
                for number in range(_CLIENTS_PER_PORT)
            ),
            *(
                self._send_messages(random.Random(f"{self.seed} {number}"), messages)
                for number in range(_CLIENTS_PER_PORT)
            ),
        ]

    def close(self) -> None:
        """Close the sockets."""
        self._context.destroy(linger=0)

    async def _send_bytes(self, rng: random.Random, port: int, corpus: tuple[bytes, ...]) -> None:
        """Connect, send, sometimes read, disconnect in one way or another; and again."""
        while True:
            with contextlib.suppress(ConnectionError):
                reader, writer = await asyncio.open_connection(HOST, port)
                self.num_connections += 1
                await self._run_session(rng, reader, writer, corpus)
            await asyncio.sleep(_PAUSE_S)

    async def _run_session(
        self,
        rng: random.Random,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        corpus: tuple[bytes, ...],
    ) -> None:
        try:
            for _ in range(rng.randrange(_MAX_BURSTS_PER_CONNECTION)):
                data = b"".join(mutate(rng, corpus) for _ in range(_CASES_PER_BURST))
                data = rng.choice(_HUGE_INPUTS) if rng.random() < 0.02 else data
                writer.write(data)
                self.sent_bytes += len(data)

                # A client that does not read its replies must not affect any other.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(writer.drain(), 1.0)
                if rng.random() < 0.5:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(65536), _PAUSE_S)
                await asyncio.sleep(_PAUSE_S)
        finally:
            writer.transport.abort()

    async def _send_messages(self, rng: random.Random, corpus: tuple[bytes, ...]) -> None:
        """Send messages of one to three parts to the stream, with a new connection now and then."""
        while True:
            socket = self._context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.connect(f"tcp://{HOST}:{self.server.stream_port}")
            self.num_connections += 1
            for _ in range(rng.randrange(_MAX_BURSTS_PER_CONNECTION)):
                for _ in range(_CASES_PER_BURST):
                    await self._send_message(rng, socket, corpus)
                await asyncio.sleep(_PAUSE_S)
            socket.close()

    async def _send_message(
        self, rng: random.Random, socket: zmq.asyncio.Socket, corpus: tuple[bytes, ...]
    ) -> None:
        count = 1 if rng.random() < 0.8 else rng.randrange(1, 4)
        parts = [mutate_message(rng, corpus) for _ in range(count)]
        with contextlib.suppress(zmq.Again):
            await socket.send_multipart(parts, flags=zmq.NOBLOCK)
            self.sent_bytes += sum(map(len, parts))
