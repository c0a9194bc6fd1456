"""One WebSocket of the page: requests as JSON, frames, robots that stop, input held back."""

from __future__ import annotations

import asyncio
import json
import logging
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import aiohttp
import pytest

from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    FrameHeader,
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
from catoptra_protocol.usarsim.reports import InitResult, OdometryReading
from catoptra_server.frames import frame as frame_module
from catoptra_server.frames.frame import IMAGE_PORT
from catoptra_server.serve.stream import peer as peer_module
from catoptra_server.serve.stream import router as router_module
from catoptra_server.serve.web import page_socket, web_server
from catoptra_server.serve.web.page_socket import (
    MaskCheck,
    PageSocket,
    WebConnection,
    resource_response,
    text_response,
)
from catoptra_server.serve.web.pages import WebResource
from catoptra_server.simulation.events import ClientDisconnected, CommandReceived, SharedRobotDriven
from helpers.fake_simulation import FakeSimulation
from helpers.live_page import PageClient, PageSession, serve_fake_page
from helpers.loopback import HOST, wait_until

SPAWN = SpawnRequest(900, "USARBot.OmniP2AT", "Mine", None, "Centre")
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)


@asynccontextmanager
async def open_page(
    simulation: FakeSimulation | None = None,
) -> AsyncIterator[tuple[PageSession, PageClient]]:
    """Serve a page, and open one WebSocket."""
    async with serve_fake_page(simulation) as session, session.open_socket() as page:
        yield session, page


async def spawn(session: PageSession, page: PageClient) -> None:
    """Spawn a robot for the only page."""
    await page.send(SPAWN)
    await wait_until(lambda: bool(session.simulation.posted_events), "spawn")
    (socket,) = session.server.sockets
    socket.peer.robot.finish_init(InitResult(0.0, "Mine"))
    socket.peer.robot.deliver([ODOMETRY])
    assert isinstance((await page.receive())[0], SensorReports)


def speeds(session: PageSession) -> list[tuple[float | None, float | None]]:
    """Wheel speeds of all commands so far."""
    return [
        (event.command.left, event.command.right)
        for event in session.simulation.posted_events
        if isinstance(event, CommandReceived) and isinstance(event.command, Drive)
    ]


async def test_requests_have_replies_in_json_with_their_ids() -> None:
    async with open_page() as (_, page):
        status = await page.request(GetStatusRequest(1))
        assert isinstance(status, StatusReply)
        assert status.num_clients == 1
        camera = await page.request(GetCameraRequest(2, ""))
        assert isinstance(camera, CameraReply)


async def test_fields_with_a_default_may_be_missing() -> None:
    async with open_page() as (_, page):
        fields = {"kind": "get_frame", "id": 5, "robot": "", "camera": "", "encoding": "raw"}
        await page.websocket.send_json(fields)
        header, _ = await page.receive()
        assert isinstance(header, FrameHeader)
        assert header.id == 5


async def test_frame_is_one_binary_message_with_the_length_of_its_header_first() -> None:
    async with open_page() as (_, page):
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


async def test_frame_request_supersedes_the_pending_one() -> None:
    async with open_page(FakeSimulation(renders_frames=False)) as (_, page):
        first, second = await page.request_frame(), await page.request_frame()
        assert (await page.receive())[0] == Error(first, f"superseded by request {second}")
        # The server goes on with other requests meanwhile.
        assert isinstance(await page.request(GetStatusRequest(77)), StatusReply)


async def test_pages_get_the_same_frame_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[object] = []
    encode = frame_module.encode_without_blocking

    async def count(rgb: object, encoding: object) -> object:
        encoded.append(encoding)
        return await encode(rgb, encoding)  # type: ignore[arg-type] # passed on

    monkeypatch.setattr(frame_module, "encode_without_blocking", count)
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
async def test_message_when_malformed_is_an_error_and_the_page_goes_on(text: str, id_: int) -> None:
    async with open_page() as (_, page):
        await page.websocket.send_str(text)
        error, _ = await page.receive()
        assert isinstance(error, Error)
        assert error.id == id_
        assert error.reason
        assert isinstance(await page.request(GetStatusRequest(7)), StatusReply)


async def test_message_when_binary_is_an_error() -> None:
    async with open_page() as (_, page):
        await page.websocket.send_bytes(b"\x81\xa4kind")
        error, _ = await page.receive()
        assert error == Error(0, "a binary message: requests are JSON text")
        assert isinstance(await page.request(GetStatusRequest(7)), StatusReply)


async def test_message_of_the_largest_size_is_read_and_a_longer_one_ends_the_socket() -> None:
    async with open_page() as (session, page):
        text = '{"kind": "get_status", "id": 3}'
        await page.websocket.send_str(text.ljust(MAX_REQUEST_BYTES))
        assert isinstance((await page.receive())[0], StatusReply)
        async with session.open_socket() as other:
            await page.websocket.send_str(text.ljust(MAX_REQUEST_BYTES + 1))
            message = await page.websocket.receive()
            assert (message.type, message.data) == (aiohttp.WSMsgType.CLOSE, 1009)
            await wait_until(lambda: len(session.server.sockets) == 1, "end of the socket")
            assert isinstance(await other.request(GetStatusRequest(1)), StatusReply)


async def test_ping_of_a_page_has_a_pong() -> None:
    async with serve_fake_page() as session:
        url = f"{session.url}/socket"
        async with session.http.ws_connect(url, origin=session.url, autoping=False) as page:
            await page.ping(b"here?")
            message = await page.receive()
            assert (message.type, message.data) == (aiohttp.WSMsgType.PONG, b"here?")


async def test_page_that_still_writes_a_message_too_long_is_not_reset() -> None:
    """A reset would overtake the close frame: the client would see no code but 1006."""
    num_pieces = 4

    async with serve_fake_page() as session:
        reader, writer = await asyncio.open_connection(HOST, session.server.port)
        writer.write(
            f"GET /socket HTTP/1.1\r\nHost: {HOST}:{session.server.port}\r\n"
            f"Origin: {session.url}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {22 * 'A'}==\r\n\r\n".encode()
        )
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"\x81\xff" + (num_pieces * MAX_REQUEST_BYTES).to_bytes(8, "big") + bytes(4))
        assert await reader.readexactly(4) == b"\x88\x02" + (1009).to_bytes(2, "big")
        for _ in range(num_pieces):
            writer.write(bytes(MAX_REQUEST_BYTES))
            await writer.drain()
        writer.close()
        await wait_until(lambda: not session.server.num_connections, "end of the connection")


async def test_page_that_answers_no_ping_is_closed_and_its_robot_removed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert 1.5 * web_server._PING_INTERVAL_S < 10.0
    monkeypatch.setattr(web_server, "_PING_INTERVAL_S", 0.1)
    async with serve_fake_page() as session:
        url = f"{session.url}/socket"
        async with session.http.ws_connect(url, origin=session.url, autoping=False) as page:
            client = PageClient(page, session.ids)
            await spawn(session, client)
            await wait_until(lambda: not session.server.sockets, "end of the socket")
            assert isinstance(session.simulation.posted_events[-1], ClientDisconnected)


async def test_socket_when_closed_removes_its_robot() -> None:
    async with serve_fake_page() as session:
        async with session.open_socket() as page:
            await spawn(session, page)
        await wait_until(
            lambda: isinstance(session.simulation.posted_events[-1], ClientDisconnected),
            "removal of the robot",
        )
        assert not session.server.sockets


async def test_fault_in_a_request_ends_that_request_only(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with open_page() as (_, page):
        with monkeypatch.context() as patch:
            patch.setattr(peer_module, "status_reply", lambda *_, **__: 1 / 0)
            reply = await page.request(GetStatusRequest(1))
            assert isinstance(reply, Error)
            assert "internal fault" in reply.reason
        assert isinstance(await page.request(GetStatusRequest(2)), StatusReply)
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize(("halt_after_s", "posted_s"), [(None, 0.25), (2.0, 2.0)])
async def test_robot_that_a_page_drives_halts_soon_after_its_last_request(
    halt_after_s: float | None, posted_s: float
) -> None:
    async with open_page() as (session, page):
        await spawn(session, page)
        for robot in ("", "Theirs"):
            await page.send(DriveRequest(1, 2.0, 1.0, False, robot, halt_after_s))
        events = session.simulation.posted_events
        await wait_until(lambda: isinstance(events[-1], SharedRobotDriven), "both drives")
        own, theirs = events[-2:]
        assert isinstance(own, CommandReceived)
        assert isinstance(theirs, SharedRobotDriven)
        assert own.command == theirs.drive == Drive(2.0, 1.0, halt_after_s=posted_s)


async def test_page_that_reads_nothing_holds_one_frame_and_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A slow machine must not end the page before it has sent its requests.
    monkeypatch.setattr(page_socket, "MAX_BLOCKED_S", math.inf)
    monkeypatch.setattr(peer_module, "MAX_BLOCKED_S", math.inf)
    simulation = FakeSimulation(1280, 960)
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
            monkeypatch.setattr(page_socket, "MAX_BLOCKED_S", 0.0)
            await wait_until(lambda: socket not in session.server.sockets, "its end")
            transport.resume_reading()


async def test_page_whose_replies_exceed_the_outbox_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(router_module, "MAX_UNSENT_MESSAGES", 16)
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


STYLES = WebResource.from_body("text/css; charset=utf-8", b"body {}")


def test_document_has_its_type_its_tag_and_is_asked_for_again() -> None:
    response = resource_response(STYLES, known_tags="")
    assert (response.status, response.body) == (200, b"body {}")
    assert response.headers["Content-Type"] == "text/css; charset=utf-8"
    assert response.headers["Cache-Control"] == "no-cache"
    assert response.headers["ETag"] == STYLES.etag


@pytest.mark.parametrize("known", ["{}", "W/{}", '"other", {}', "*"])
def test_document_when_it_is_known_has_no_body(known: str) -> None:
    response = resource_response(STYLES, known_tags=known.format(STYLES.etag))
    assert response.status == 304
    assert not response.body
    assert "Content-Security-Policy" in response.headers


@pytest.mark.parametrize("known", ['"other"', "{}x", "x{}"])
def test_document_when_another_is_known_has_its_body(known: str) -> None:
    response = resource_response(STYLES, known_tags=known.format(STYLES.etag))
    assert response.status == 200


def test_text_is_plain_and_never_stored() -> None:
    response = text_response(403, "no", headers={"Allow": "GET"})
    assert response.headers["Content-Type"] == "text/plain; charset=utf-8"
    assert response.headers["Cache-Control"] == "no-store"
    assert response.headers["Allow"] == "GET"


MASK = b"abcd"
MASKED = (
    b"\x81\x82" + MASK + b"hi"  # a text of two bytes
    + b"\x81\xfe\x01\x00" + MASK + bytes(256)
    + b"\x82\xff" + (70_000).to_bytes(8, "big") + MASK + bytes(70_000)
    + b"\x89\x80" + MASK  # an empty ping
)  # fmt: skip


@pytest.mark.parametrize("piece_bytes", [1, 7, 100_000])
@pytest.mark.parametrize(("last", "is_masked"), [(b"\x81\x82", True), (b"\x81\x02", False)])
def test_frame_without_a_mask_is_found_behind_others(
    piece_bytes: int, last: bytes, is_masked: bool
) -> None:
    data, check = MASKED + last, MaskCheck()
    pieces = [data[begin : begin + piece_bytes] for begin in range(0, len(data), piece_bytes)]
    assert all([check.feed(piece) for piece in pieces]) is is_masked


async def test_page_that_sends_a_frame_without_a_mask_is_closed() -> None:
    async with open_page() as (session, page):
        assert isinstance(await page.request(GetStatusRequest(1)), StatusReply)
        transport = page.websocket._writer.transport
        assert transport is not None
        transport.write(b"\x81\x02hi")
        await wait_until(lambda: not session.server.num_connections, "end of the connection")


def only_connection(session: PageSession) -> WebConnection:
    (connection,) = session.server._port
    return connection


async def test_dialogue_is_never_held_back() -> None:
    async with serve_fake_page() as session, session.open_socket() as page:
        for number in range(1, 400):
            await page.request(GetStatusRequest(number))
            assert only_connection(session)._hold is None


async def test_flood_of_messages_is_held_back_and_another_page_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    num_handled = 0

    def count(socket: PageSocket, text: str) -> None:
        nonlocal num_handled
        num_handled += text == "{}"
        handle_text(socket, text)

    handle_text = PageSocket._handle_text
    monkeypatch.setattr(PageSocket, "_handle_text", count)
    async with (
        serve_fake_page() as session,
        session.open_socket() as other,
        session.open_socket() as flooding,
    ):
        begin_s = asyncio.get_running_loop().time()
        for _ in range(2000):
            await flooding.websocket.send_str("{}")
        for number in range(1, 100):
            await other.request(GetStatusRequest(number))
        duration_s = asyncio.get_running_loop().time() - begin_s
        # A message in 4 ms at most, after those of the first 0.1 s.
        assert 0 < num_handled < 300 + 250 * duration_s
        # Its end would wait behind its messages.
        flooding.websocket._writer.transport.abort()


async def test_exception_that_aiohttp_catches_is_logged_as_a_fault(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serve_fake_page() as session:
        with monkeypatch.context() as patch:
            patch.setattr(type(session.server), "_respond", lambda *_: 1 / 0)
            response = await session.get("/")
        assert response.status == 500
        assert "Content-Security-Policy" in response.headers
        assert (await session.get("/")).status == 200
    assert "a web request of 127.0.0.1" in caplog.text
    assert "ZeroDivisionError" in caplog.text


async def test_peer_that_leaves_within_a_request_is_no_error(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    async with serve_fake_page() as session:
        _, writer = await asyncio.open_connection("127.0.0.1", session.server.port)
        writer.write(b"GET / HT")
        await wait_until(lambda: session.server.num_connections == 1, "connection")
        writer.close()
        await wait_until(lambda: session.server.num_connections == 0, "its end")
    assert not caplog.records
