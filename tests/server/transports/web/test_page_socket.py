"""The WebSocket of a page: the stream's requests as JSON, frames as binary messages."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Awaitable, Callable

import aiohttp
import pytest

from catoptra_protocol.stream.codec import MAX_REQUEST_BYTES
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    FrameHeader,
    Ok,
    SensorReports,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetCameraRequest,
    GetStatusRequest,
    ImageEncoding,
    SpawnRequest,
)
from catoptra_protocol.usarsim.commands import Drive
from catoptra_protocol.usarsim.reports import OdometryReading
from catoptra_server.frames import frame as frame_module
from catoptra_server.frames.frame import IMAGE_PORT
from catoptra_server.serve.stream import peer as stream_peer
from catoptra_server.serve.stream import router as outbox
from catoptra_server.serve.web import page_socket, web_server
from catoptra_server.serve.web import page_socket as dead_man_switch
from catoptra_server.simulation import ClientDisconnected, CommandReceived, SharedRobotDriven
from helpers.fake_simulation import FakeSimulation
from helpers.live_page import PageClient, PageSession, serve_fake_page
from helpers.loopback import run_scenario, wait_until

SPAWN = SpawnRequest(900, "USARBot.OmniP2AT", "Mine", None, "Centre")
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)

Play = Callable[[PageSession, PageClient], Awaitable[None]]


def run_page(play: Play, simulation: FakeSimulation | None = None) -> None:
    """Run a coroutine function with a served page and one WebSocket."""

    async def scenario() -> None:
        async with serve_fake_page(simulation) as session, session.open_socket() as page:
            await play(session, page)

    run_scenario(scenario())


async def spawn(session: PageSession, page: PageClient) -> None:
    """Spawn a robot for the only page."""
    await page.send(SPAWN)
    await wait_until(lambda: bool(session.simulation.posted_events), "spawn")
    (socket,) = session.server.sockets
    socket.peer.robot.confirm_spawn("Mine", None)
    socket.peer.robot.deliver([ODOMETRY])
    assert isinstance((await page.receive())[0], SensorReports)


def speeds(session: PageSession) -> list[tuple[float | None, float | None]]:
    """Wheel speeds of all commands so far."""
    return [
        (event.command.left, event.command.right)
        for event in session.simulation.posted_events
        if isinstance(event, CommandReceived) and isinstance(event.command, Drive)
    ]


def test_requests_have_replies_in_json_with_their_ids() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        status = await page.request(GetStatusRequest(1))
        assert isinstance(status, StatusReply)
        assert status.num_clients == 1
        camera = await page.request(GetCameraRequest(2, ""))
        assert isinstance(camera, CameraReply)

    run_page(play)


def test_fields_with_a_default_may_be_missing() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        fields = {"kind": "get_frame", "id": 5, "robot": "", "camera": "", "encoding": "raw"}
        await page.websocket.send_json(fields)
        header, _ = await page.receive()
        assert isinstance(header, FrameHeader)
        assert header.id == 5

    run_page(play)


def test_frame_is_one_binary_message_with_the_length_of_its_header_first() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        await page.request_frame(ImageEncoding.RAW)
        message = await page.websocket.receive()
        assert message.type is aiohttp.WSMsgType.BINARY
        length = int.from_bytes(message.data[:4], "little")
        header = json.loads(message.data[4 : 4 + length])
        assert next(iter(header)) == "kind"
        assert (header["kind"], header["width_px"], header["height_px"]) == ("frame", 8, 6)
        assert message.data[4 + length :] == bytes([1]) * 8 * 6 * 3
        _, jpeg = await page.get_frame(ImageEncoding.JPEG)
        assert jpeg.startswith(b"\xff\xd8")

    run_page(play)


def test_frame_request_supersedes_the_pending_one() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        first, second = await page.request_frame(), await page.request_frame()
        assert (await page.receive())[0] == Error(first, f"superseded by request {second}")
        # The server goes on with other requests meanwhile.
        assert isinstance(await page.request(GetStatusRequest(77)), StatusReply)

    run_page(play, FakeSimulation(renders_frames=False))


def test_pages_get_the_same_frame_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[object] = []
    encode = frame_module.encode_without_blocking

    async def count(rgb: object, encoding: object) -> object:
        encoded.append(encoding)
        return await encode(rgb, encoding)  # type: ignore[arg-type] # passed on

    monkeypatch.setattr(frame_module, "encode_without_blocking", count)

    async def scenario() -> None:
        simulation = FakeSimulation(renders_frames=False)
        async with (
            serve_fake_page(simulation) as session,
            session.open_socket() as first,
            session.open_socket() as second,
        ):
            for page in (first, second):
                await page.request_frame(ImageEncoding.JPEG)
                assert isinstance(await page.request(GetStatusRequest(900)), StatusReply)
            simulation.renders_frames = True
            simulation._render(IMAGE_PORT)
            (header, image), (other_header, other_image) = [
                await page.receive() for page in (first, second)
            ]
        assert isinstance(header, FrameHeader)
        assert isinstance(other_header, FrameHeader)
        assert header.sequence == other_header.sequence
        assert image == other_image
        assert len(encoded) == 1

    run_scenario(scenario())


MALFORMED = {
    "empty": ("", 0),
    "no JSON": ("{", 0),
    "no object": ("[1]", 0),
    "no kind": ('{"id": 3}', 3),
    "unknown kind": ('{"kind": "fly", "id": 3}', 3),
    "missing field": ('{"kind": "step", "id": 3}', 3),
    "not a number": ('{"kind": "step", "id": 3, "time_s": NaN}', 0),
    "infinite": ('{"kind": "step", "id": 3, "time_s": 1e999}', 0),
    "id 0": ('{"kind": "get_status", "id": 0}', 0),
    "deep": (7000 * "[", 0),
    "a reply": ('{"kind": "heartbeat", "version": 1}', 0),
}


@pytest.mark.parametrize(("text", "id_"), MALFORMED.values(), ids=MALFORMED.keys())
def test_message_when_malformed_is_an_error_and_the_page_goes_on(text: str, id_: int) -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        await page.websocket.send_str(text)
        error, _ = await page.receive()
        assert isinstance(error, Error)
        assert error.id == id_
        assert error.reason
        assert isinstance(await page.request(GetStatusRequest(7)), StatusReply)

    run_page(play)


def test_message_when_binary_is_an_error() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        await page.websocket.send_bytes(b"\x81\xa4kind")
        error, _ = await page.receive()
        assert error == Error(0, "a binary message: requests are JSON text")
        assert isinstance(await page.request(GetStatusRequest(7)), StatusReply)

    run_page(play)


def test_message_of_the_largest_size_is_read_and_a_longer_one_ends_the_socket() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        text = '{"kind": "get_status", "id": 3}'
        await page.websocket.send_str(text.ljust(MAX_REQUEST_BYTES))
        assert isinstance((await page.receive())[0], StatusReply)
        async with session.open_socket() as other:
            await page.websocket.send_str(text.ljust(MAX_REQUEST_BYTES + 1))
            message = await page.websocket.receive()
            assert (message.type, message.data) == (aiohttp.WSMsgType.CLOSE, 1009)
            await wait_until(lambda: len(session.server.sockets) == 1, "end of the socket")
            assert isinstance(await other.request(GetStatusRequest(1)), StatusReply)

    run_page(play)


def test_ping_of_a_page_has_a_pong() -> None:
    async def scenario() -> None:
        async with serve_fake_page() as session:
            url = f"{session.url}/socket"
            async with session.http.ws_connect(url, origin=session.url, autoping=False) as page:
                await page.ping(b"here?")
                message = await page.receive()
                assert (message.type, message.data) == (aiohttp.WSMsgType.PONG, b"here?")

    run_scenario(scenario())


def test_page_that_answers_no_ping_is_closed_and_its_robot_removed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert 1.5 * web_server._PING_INTERVAL_S < 10.0
    monkeypatch.setattr(web_server, "_PING_INTERVAL_S", 0.1)

    async def scenario() -> None:
        async with serve_fake_page() as session:
            url = f"{session.url}/socket"
            async with session.http.ws_connect(url, origin=session.url, autoping=False) as page:
                client = PageClient(page, session.ids)
                await spawn(session, client)
                await wait_until(lambda: not session.server.sockets, "end of the socket")
                assert isinstance(session.simulation.posted_events[-1], ClientDisconnected)

    run_scenario(scenario())


def test_socket_when_closed_removes_its_robot() -> None:
    async def scenario() -> None:
        async with serve_fake_page() as session:
            async with session.open_socket() as page:
                await spawn(session, page)
            await wait_until(
                lambda: isinstance(session.simulation.posted_events[-1], ClientDisconnected),
                "removal of the robot",
            )
            assert not session.server.sockets

    run_scenario(scenario())


def test_fault_in_a_request_ends_that_request_only(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(stream_peer, "status_reply", lambda *_, **__: 1 / 0)
            reply = await page.request(GetStatusRequest(1))
            assert isinstance(reply, Error)
            assert "internal fault" in reply.reason
        assert isinstance(await page.request(GetStatusRequest(2)), StatusReply)

    run_page(play)
    assert "ZeroDivisionError" in caplog.text


def test_robot_stops_when_its_page_sends_no_more_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        await spawn(session, page)
        assert await page.request(DriveRequest(1, 2.0, 1.0, False)) == Ok(1)
        begin_s = asyncio.get_running_loop().time()
        await wait_until(lambda: len(speeds(session)) == 2, "stop")
        assert speeds(session) == [(2.0, 1.0), (0.0, 0.0)]
        waited_s = asyncio.get_running_loop().time() - begin_s
        assert waited_s > 0.9 * dead_man_switch.DRIVE_TIMEOUT_S
        # The page may drive again.
        assert await page.request(DriveRequest(2, 1.0, 1.0, False)) == Ok(2)
        assert await page.request(DriveRequest(3, 0.0, 0.0, False)) == Ok(3)
        assert len(speeds(session)) == 4

    run_page(play)


def test_shared_robot_stops_when_its_page_sends_no_more_drives() -> None:
    async def play(session: PageSession, page: PageClient) -> None:
        await page.send(DriveRequest(1, 2.0, 1.0, False, "Theirs"))
        await wait_until(lambda: len(session.simulation.posted_events) == 2, "drive and stop")
        drive, stop = session.simulation.posted_events
        assert isinstance(drive, SharedRobotDriven)
        assert isinstance(stop, SharedRobotDriven)
        assert (stop.robot, stop.drive.left, stop.drive.right) == ("Theirs", 0.0, 0.0)

    run_page(play)


def test_page_that_reads_nothing_holds_one_frame_and_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A slow machine must not end the page before it has sent its requests.
    monkeypatch.setattr(page_socket, "_MAX_SENDING_S", math.inf)
    monkeypatch.setattr(stream_peer, "_MAX_BLOCKED_S", math.inf)
    simulation = FakeSimulation(1280, 960)

    async def scenario() -> None:
        async with serve_fake_page(simulation) as session, session.open_socket() as other:
            url = f"{session.url}/socket"
            async with session.http.ws_connect(url, origin=session.url) as stalled:
                client = PageClient(stalled, session.ids)
                # aiohttp's client would read ahead.
                transport = stalled._writer.transport
                transport.pause_reading()
                for _ in range(20):
                    await client.request_frame()
                    await other.get_frame()
                (socket,) = [one for one in session.server.sockets if one._sending is not None]
                # One is being sent, one waits.
                assert len(socket.peer.outbox._waiting) <= 20
                assert sum(len(parts) == 2 for parts in socket.peer.outbox._waiting) <= 1
                monkeypatch.setattr(page_socket, "_MAX_SENDING_S", 0.0)
                await wait_until(lambda: socket not in session.server.sockets, "its end")
                transport.resume_reading()

    run_scenario(scenario())


def test_page_whose_replies_exceed_the_outbox_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "_MAX_MESSAGES", 16)

    async def scenario() -> None:
        async with serve_fake_page(FakeSimulation(1280, 960)) as session:
            url = f"{session.url}/socket"
            async with session.http.ws_connect(url, origin=session.url) as stalled:
                stalled._writer.transport.pause_reading()
                client = PageClient(stalled, session.ids)
                (socket,) = session.server.sockets
                # Frames fill the buffers of the kernel, so that replies wait.
                while not socket.peer.outbox.is_blocked:
                    await client.request_frame()
                    await asyncio.sleep(0)
                number = 2000
                while session.server.sockets:
                    number += 1
                    try:
                        await client.send(GetStatusRequest(number))
                    except ConnectionError:
                        break
                    assert len(socket.peer.outbox._waiting) <= 17
                    await asyncio.sleep(0)
                await wait_until(lambda: not session.server.sockets, "end of the socket")
                stalled._writer.transport.abort()

    run_scenario(scenario())
