"""The honest load, on one asyncio loop: a robot that turns, and clients of its camera.

Two viewers, a collector of labels and a page request one frame after the other, as fast as the
server replies; newcomers connect to the old ports. The robot turns on the spot: one that drove was
soon held up by the robots of attackers, and the server had nothing new to draw.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass, field
from itertools import count, cycle

import aiohttp
import zmq
import zmq.asyncio

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import Error, FrameHeader
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from catoptra_protocol.usarsim.commands import Drive, Init, StepCommand
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.image_port import ImageFrameReader, encode_full_frame_request
from catoptra_protocol.usarsim.reports import CommandResult, VehicleStatus
from helpers.live_page import PageClient
from load.attack_tools import HONEST_ROBOT, HOST, AttackedPorts

IMAGE_VIEWER, STREAM_VIEWER, COLLECTOR, PAGE = "image port", "stream", "labels", "page"

_STEP_S = 0.2
# A newcomer without a reply until then is a fault.
_NEWCOMER_TIMEOUT_S = 30.0


@dataclass
class HonestRecord:
    """Arrival times of all that honest clients received, by the monotonic clock."""

    reports_s: list[float] = field(default_factory=list)
    """Ends of sensor cycles: STA in real time, RES of a step under lockstep."""
    frames_s: dict[str, list[float]] = field(
        default_factory=lambda: {IMAGE_VIEWER: [], STREAM_VIEWER: [], COLLECTOR: [], PAGE: []}
    )
    """Frames by viewer."""
    newcomers_s: list[float] = field(default_factory=list)
    """Times from the connection of a newcomer to its first reply."""
    faults: list[str] = field(default_factory=list)
    """Errors and disconnections, in words."""

    def has_started(self) -> bool:
        """Whether the robot and each viewer have received something."""
        return all((self.reports_s, *self.frames_s.values()))


@asynccontextmanager
async def run_honest_clients(
    ports: AttackedPorts, *, has_lockstep: bool
) -> AsyncIterator[HonestRecord]:
    """Run the honest clients for the length of a block."""
    record = HonestRecord()
    run_robot = _run_stepping_robot if has_lockstep else _run_robot
    clients = (
        _record_faults("robot", run_robot(ports, record), record),
        _record_faults(IMAGE_VIEWER, _run_image_viewer(ports, record), record),
        _record_faults(STREAM_VIEWER, _run_stream_viewer(ports, record), record),
        _record_faults(COLLECTOR, _run_collector(ports, record), record),
        _record_faults(PAGE, _run_page(ports, record), record),
        _record_faults("newcomers", _run_newcomers(ports, record), record),
    )
    tasks = [asyncio.create_task(client) for client in clients]
    try:
        yield record
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _record_faults(
    name: str, client: Coroutine[object, object, None], record: HonestRecord
) -> None:
    """Run a client; record its end, which no honest client chooses."""
    try:
        await client
        record.faults.append(f"{name}: the server ended the connection")
    except (OSError, RemoteProtocolError) as error:
        record.faults.append(f"{name}: {error}")


async def _run_robot(ports: AttackedPorts, record: HonestRecord) -> None:
    """Turn, and record each status."""
    reader, writer = await asyncio.open_connection(HOST, ports.control)
    protocol = ControlClient()
    with closing(writer):
        writer.write(protocol.send(Init("USARBot.OmniP2AT", HONEST_ROBOT, start="Centre")))
        writer.write(protocol.send(Drive(1.0, -1.0)))
        while data := await reader.read(65536):
            now_s = time.monotonic()
            reports = protocol.receive(data)
            record.reports_s += [now_s for report in reports if isinstance(report, VehicleStatus)]


async def _run_stepping_robot(ports: AttackedPorts, record: HonestRecord) -> None:
    """Drive in circles by one step after the other, and record each result."""
    reader, writer = await asyncio.open_connection(HOST, ports.control)
    protocol = ControlClient()
    with closing(writer):
        writer.write(protocol.send(Init("USARBot.OmniP2AT", HONEST_ROBOT, start="Centre")))
        writer.write(protocol.send(Drive(1.0, -1.0)) + protocol.send(StepCommand(_STEP_S)))
        while data := await reader.read(65536):
            if any(isinstance(report, CommandResult) for report in protocol.receive(data)):
                record.reports_s.append(time.monotonic())
                writer.write(protocol.send(StepCommand(_STEP_S)))


async def _run_image_viewer(ports: AttackedPorts, record: HonestRecord) -> None:
    reader, writer = await asyncio.open_connection(HOST, ports.image)
    frames = ImageFrameReader()
    with closing(writer):
        writer.write(encode_full_frame_request())
        while data := await reader.read(1 << 18):
            for _ in frames.receive(data):
                record.frames_s[IMAGE_VIEWER].append(time.monotonic())
                writer.write(encode_full_frame_request())


async def _run_stream_viewer(ports: AttackedPorts, record: HonestRecord) -> None:
    await _request_frames(ports, record, STREAM_VIEWER, ())


async def _run_collector(ports: AttackedPorts, record: HonestRecord) -> None:
    await _request_frames(ports, record, COLLECTOR, ("range",))


async def _request_frames(
    ports: AttackedPorts, record: HonestRecord, name: str, labels: tuple[str, ...]
) -> None:
    """Request frames of the robot; an error before its spawn is repeated, a later one a fault."""
    context = zmq.asyncio.Context()
    try:
        with context.socket(zmq.DEALER) as peer:
            peer.set(zmq.LINGER, 0)
            peer.connect(f"tcp://{HOST}:{ports.stream}")
            for id_ in count(1):
                request = GetFrameRequest(id_, HONEST_ROBOT, "", ImageEncoding.RAW, channels=labels)
                await peer.send(bytes_from_message(request))
                reply = await _receive_frame(peer)
                if isinstance(reply, FrameHeader):
                    record.frames_s[name].append(time.monotonic())
                elif record.frames_s[name]:
                    raise RemoteProtocolError(reply.reason)
                else:
                    await asyncio.sleep(0.1)
    finally:
        context.destroy(linger=0)


async def _run_page(ports: AttackedPorts, record: HonestRecord) -> None:
    url = f"http://{HOST}:{ports.page}"
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{url}/socket", origin=url, max_msg_size=0) as websocket,
    ):
        page = PageClient(websocket)
        for id_ in count(1):
            await page.send(GetFrameRequest(id_, HONEST_ROBOT, "", ImageEncoding.JPEG))
            reply, _ = await page.receive()
            if isinstance(reply, FrameHeader):
                record.frames_s[PAGE].append(time.monotonic())
            elif record.frames_s[PAGE]:
                raise RemoteProtocolError(str(reply))
            else:
                await asyncio.sleep(0.1)


async def _run_newcomers(ports: AttackedPorts, record: HonestRecord) -> None:
    """Connect to control and image port in turn, once a second, and wait for the first reply."""
    for port, request in cycle(((ports.control, b"GETSTARTPOSES\r\n"), (ports.image, b"OK"))):
        begin_s = time.monotonic()
        async with asyncio.timeout(_NEWCOMER_TIMEOUT_S):
            reader, writer = await asyncio.open_connection(HOST, port)
            with closing(writer):
                writer.write(request)
                if not await reader.read(1):
                    raise RemoteProtocolError("a newcomer was disconnected")
        record.newcomers_s.append(time.monotonic() - begin_s)
        await asyncio.sleep(1.0)


async def _receive_frame(peer: zmq.asyncio.Socket) -> FrameHeader | Error:
    """Reply to the request of a frame; heartbeats in between are skipped."""
    while True:
        parts = await peer.recv_multipart()
        reply = reply_from_bytes(parts[0])
        if isinstance(reply, FrameHeader | Error):
            return reply
