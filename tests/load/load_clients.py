"""Clients of the load test, on one asyncio loop: many regular ones, and some adversarial ones."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import time
from dataclasses import dataclass, field
from itertools import count

import zmq
import zmq.asyncio

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import Error, FrameHeader
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from catoptra_protocol.usarsim.commands import Drive, GetConf, Init
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.image_port import ImageFrameReader, encode_full_frame_request
from catoptra_protocol.usarsim.reports import VehicleStatus
from helpers import zmtp


@dataclass
class LoadRecord:
    """Observations of the regular clients."""

    status_times_s: dict[int, list[float]] = field(default_factory=dict)
    """Arrival times of STA by number of the controller."""
    frames: dict[str, int] = field(default_factory=dict)
    """Number of frames by viewer."""
    faults: list[str] = field(default_factory=list)
    """Errors, disconnections and frames out of order."""


@dataclass(frozen=True, slots=True)
class ServerEndpoints:
    """Address and ports of the server."""

    host: str
    control_port: int
    image_port: int
    stream_port: int


async def run_controller(address: ServerEndpoints, number: int, record: LoadRecord) -> None:
    """Spawn a robot, drive every second one in circles, and record the arrival of its status."""
    reader, writer = await asyncio.open_connection(address.host, address.control_port)
    protocol = ControlClient()
    row, column = divmod(number, 9)
    location_m = (1.1 * (column - 4), 0.95 * (row - 3.5), 0.0)  # a grid over the laboratory
    writer.write(protocol.send(Init("USARBot.OmniP2AT", f"Soak{number}", location_m)))
    if number % 2:
        writer.write(protocol.send(Drive(1.0, 0.4)))
    arrivals = record.status_times_s.setdefault(number, [])
    try:
        while data := await reader.read(65536):
            now = time.monotonic()
            reports = protocol.receive(data)
            arrivals.extend(now for report in reports if isinstance(report, VehicleStatus))
        record.faults.append(f"controller {number} was disconnected")
    except (ConnectionError, RemoteProtocolError) as error:
        record.faults.append(f"controller {number}: {error}")
    finally:
        writer.close()


async def run_viewer(
    address: ServerEndpoints, number: int, record: LoadRecord, *, pause_s: float
) -> None:
    """Request frame after frame, with a pause between; each must be complete."""
    reader, writer = await asyncio.open_connection(address.host, address.image_port)
    frames = ImageFrameReader()
    name = f"viewer {number}"
    record.frames[name] = 0
    try:
        writer.write(encode_full_frame_request())
        while data := await reader.read(1 << 18):
            for frame in frames.receive(data):
                record.frames[name] += 1
                if frame.payload[:2] != b"\xff\xd8" or frame.payload[-2:] != b"\xff\xd9":
                    record.faults.append(f"{name}: a frame that is no JPEG")
                await asyncio.sleep(pause_s)
                writer.write(encode_full_frame_request())
        record.faults.append(f"{name} was disconnected")
    except (ConnectionError, RemoteProtocolError) as error:
        record.faults.append(f"{name}: {error}")
    finally:
        writer.close()


async def run_stream_viewer(
    address: ServerEndpoints, number: int, record: LoadRecord, *, robot: str
) -> None:
    """Request frames of one robot, or of the default camera, on the stream; each must be newer."""
    context = zmq.asyncio.Context()
    name = f"stream viewer {number}"
    record.frames[name] = 0
    last = 0
    try:
        with context.socket(zmq.DEALER) as peer:
            peer.connect(f"tcp://{address.host}:{address.stream_port}")
            for id_ in count(1):
                request = bytes_from_message(GetFrameRequest(id_, robot, "", ImageEncoding.JPEG))
                await peer.send(request)
                header = await _receive_stream_frame(peer)
                if not isinstance(header, FrameHeader):  # the robot is not spawned yet
                    await asyncio.sleep(0.1)
                    continue
                record.frames[name] += 1
                if header.sequence <= last or header.robot not in (robot or header.robot):
                    record.faults.append(f"{name}: frame {header.sequence} after {last}")
                last = header.sequence
    except RemoteProtocolError as error:
        record.faults.append(f"{name}: {error}")
    finally:
        context.destroy(linger=0)


async def _receive_stream_frame(peer: zmq.asyncio.Socket) -> FrameHeader | Error:
    """Reply to the request of a frame; heartbeats in between are skipped."""
    while True:
        parts = await peer.recv_multipart()
        reply = reply_from_bytes(parts[0])
        if isinstance(reply, FrameHeader | Error):
            return reply


async def run_unterminated_stream_client(address: ServerEndpoints) -> None:
    """Send the parts of an unterminated message until disconnected, and reconnect."""
    loop = asyncio.get_running_loop()
    while True:
        connection = await _connect(address.host, address.stream_port)
        with contextlib.closing(connection), contextlib.suppress(ConnectionError):
            await loop.sock_sendall(connection, zmtp.GREETING + zmtp.READY)
            await loop.sock_recv(connection, 4096)
            await asyncio.sleep(0.2)
            while True:
                await loop.sock_sendall(connection, 1000 * zmtp.zmtp_frame(b"part", zmtp.MORE))
                await asyncio.sleep(0.05)


async def run_unread_viewer(address: ServerEndpoints) -> None:
    """Request frames without end, and read none."""
    connection = await _connect(address.host, address.image_port)
    with contextlib.closing(connection), contextlib.suppress(ConnectionError):
        loop = asyncio.get_running_loop()
        while True:
            await loop.sock_sendall(connection, encode_full_frame_request())
            await asyncio.sleep(0.05)


async def run_resetting_viewer(address: ServerEndpoints) -> None:
    """Reset the connection within a frame, again and again."""
    loop = asyncio.get_running_loop()
    while True:
        connection = await _connect(address.host, address.image_port)
        with contextlib.suppress(ConnectionError):
            await loop.sock_sendall(connection, encode_full_frame_request())
            await loop.sock_recv(connection, 1000)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()
        await asyncio.sleep(0.5)


async def run_unterminated_controller(address: ServerEndpoints) -> None:
    """Send 64 kB without a line end, again and again."""
    loop = asyncio.get_running_loop()
    while True:
        connection = await _connect(address.host, address.control_port)
        with contextlib.closing(connection), contextlib.suppress(ConnectionError):
            for _ in range(20):
                await loop.sock_sendall(connection, b"DRIVE {Left 1.0} " * 4096)
                await asyncio.sleep(0.5)


async def run_unread_controller(address: ServerEndpoints) -> None:
    """Query configurations without reading replies until disconnected, and reconnect."""
    loop = asyncio.get_running_loop()
    protocol = ControlClient()
    while True:
        connection = await _connect(address.host, address.control_port)
        with contextlib.closing(connection), contextlib.suppress(ConnectionError):
            init = protocol.send(Init("USARBot.OmniP2AT", "Unread", (0.0, 0.0, 0.0)))
            await loop.sock_sendall(connection, init)
            while True:
                await loop.sock_sendall(connection, protocol.send(GetConf("Camera")) * 20)
                await asyncio.sleep(0.05)


async def _connect(host: str, port: int) -> socket.socket:
    connection = socket.socket()
    connection.setblocking(False)
    await asyncio.get_running_loop().sock_connect(connection, (host, port))
    return connection
