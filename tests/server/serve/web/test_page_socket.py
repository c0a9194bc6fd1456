"""One WebSocket of the page: requests as JSON, frames, robots that stop, input held back."""

from __future__ import annotations

import asyncio
import json
import logging
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
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    SpawnRequest,
)
from catoptra_protocol.usarsim.commands import Drive
from catoptra_protocol.usarsim.reports import OdometryReading
from catoptra_server.frames import frame as frame_module
from catoptra_server.frames.frame import IMAGE_PORT
from catoptra_server.serve.limits import LoopShare
from catoptra_server.serve.stream import peer as peer_module
from catoptra_server.serve.stream import router as router_module
from catoptra_server.serve.web import page_socket, web_server
from catoptra_server.serve.web.page_socket import (
    DeadManSwitch,
    PageSocket,
    WebConnection,
    resource_response,
    text_response,
)
from catoptra_server.serve.web.pages import WebResource
from catoptra_server.simulation.events import ClientDisconnected, CommandReceived, SharedRobotDriven
from helpers.fake_simulation import FakeSimulation
from helpers.live_page import PageClient, PageSession, serve_fake_page
from helpers.loopback import run_scenario, wait_until

SPAWN = SpawnRequest(900, "USARBot.OmniP2AT", "Mine", None, "Centre")
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)

Play = Callable[[PageSession, PageClient], Awaitable[None]]

DRIVE_TIMEOUT_S = 0.25


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
            patch.setattr(peer_module, "status_reply", lambda *_, **__: 1 / 0)
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
        assert waited_s > 0.9 * DRIVE_TIMEOUT_S
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
    monkeypatch.setattr(peer_module, "_MAX_BLOCKED_S", math.inf)
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
    monkeypatch.setattr(router_module, "_MAX_MESSAGES", 16)

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


class Clock:
    """Time and pending calls, under control of the test."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.calls: list[_Call] = []

    def call_later(self, delay_s: float, function: Callable[[], None]) -> _Call:
        call = _Call(self.now_s + delay_s, function)
        self.calls.append(call)
        return call

    def advance(self, duration_s: float) -> None:
        self.now_s += duration_s
        for call in [call for call in self.calls if call.at_s <= self.now_s]:
            self.calls.remove(call)
            if not call.is_cancelled:
                call.function()


class _Call:
    def __init__(self, at_s: float, function: Callable[[], None]) -> None:
        self.at_s, self.function, self.is_cancelled = at_s, function, False

    def cancel(self) -> None:
        self.is_cancelled = True


class Scene:
    """A switch, its clock, and the robots that it has stopped."""

    def __init__(self) -> None:
        self.clock, self.stopped = Clock(), list[str]()
        self.switch = DeadManSwitch(self.stopped.append, call_later=self.clock.call_later)

    def drive(self, left: float | None, right: float | None, robot: str = "") -> None:
        self.switch.record_drive(DriveRequest(1, left, right, False, robot))


def test_robot_when_requests_end_stops_once_within_a_quarter_of_a_second() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.clock.advance(0.99 * DRIVE_TIMEOUT_S)
    assert scene.stopped == []
    scene.clock.advance(0.02 * DRIVE_TIMEOUT_S)
    assert scene.stopped == [""]
    scene.clock.advance(10.0)
    assert scene.stopped == [""]


def test_robot_when_requests_go_on_does_not_stop() -> None:
    scene = Scene()
    for _ in range(100):
        scene.drive(1.0, -1.0)
        scene.clock.advance(0.05)
    assert scene.stopped == []


def test_robot_when_it_stands_is_not_stopped() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.drive(0.0, 0.0)
    scene.drive(None, None)
    scene.clock.advance(10.0)
    assert scene.stopped == []


@pytest.mark.parametrize(("left", "right"), [(0.0, None), (None, 0.0), (None, None)])
def test_robot_when_a_side_is_left_unchanged_still_moves(
    left: float | None, right: float | None
) -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.drive(left, right)
    scene.clock.advance(DRIVE_TIMEOUT_S)
    assert scene.stopped == [""]


def test_each_driven_robot_has_its_own_time() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0, "A")
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    scene.drive(1.0, 1.0, "B")
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    assert scene.stopped == ["A"]
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    assert scene.stopped == ["A", "B"]


def test_robots_of_many_names_are_forgotten_after_their_stop() -> None:
    scene = Scene()
    for number in range(1000):
        scene.drive(1.0, 1.0, str(number))
    scene.clock.advance(DRIVE_TIMEOUT_S)
    assert len(scene.stopped) == 1000
    assert not scene.switch._speeds
    assert not scene.switch._timers


def test_switch_when_closed_stops_nothing_more() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.switch.close()
    scene.clock.advance(10.0)
    assert scene.stopped == []


def only_connection(session: PageSession) -> WebConnection:
    (connection,) = session.server._connections
    return connection


def test_dialogue_is_never_held_back() -> None:
    async def scenario() -> None:
        async with serve_fake_page() as session, session.open_socket() as page:
            for number in range(1, 400):
                await page.request(GetStatusRequest(number))
                assert only_connection(session)._hold is None

    run_scenario(scenario())


def test_request_of_one_of_eight_pages_with_two_pending_does_not_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As with many pages, whose prices for one request are above the burst; a wait would not end.
    monkeypatch.setattr(LoopShare, "remaining_wait_s", lambda *_: 60.0)
    # Reading goes on: only the wait before a request is tested.
    monkeypatch.setattr(WebConnection, "_hold_back", lambda _: None)
    simulation = FakeSimulation(renders_frames=False)

    async def scenario() -> None:
        async with serve_fake_page(simulation) as session, session.open_socket() as page:
            await page.request_frame()
            await page.send(GetStateRequest(next(page.ids), ""))
            await page.request(GetStatusRequest(next(page.ids)))

    run_scenario(scenario())


def test_flood_of_messages_is_held_back_and_another_page_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    num_handled = 0

    def count(socket: PageSocket, text: str) -> None:
        nonlocal num_handled
        num_handled += text == "{}"
        handle_text(socket, text)

    handle_text = PageSocket._handle_text
    monkeypatch.setattr(PageSocket, "_handle_text", count)

    async def scenario() -> None:
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
            # A message in 4 ms at most, after the first ones.
            assert 0 < num_handled < 20 + 250 * duration_s
            # Its end would wait behind its messages.
            flooding.websocket._writer.transport.abort()

    run_scenario(scenario())


def test_exception_that_aiohttp_catches_is_logged_as_a_fault(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        async with serve_fake_page() as session:
            with monkeypatch.context() as patch:
                patch.setattr(type(session.server), "_respond", lambda *_: 1 / 0)
                response = await session.get("/")
            assert response.status == 500
            assert "Content-Security-Policy" in response.headers
            assert (await session.get("/")).status == 200

    run_scenario(scenario())
    assert "a web request of 127.0.0.1" in caplog.text
    assert "ZeroDivisionError" in caplog.text


def test_peer_that_leaves_within_a_request_is_no_error(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario() -> None:
        async with serve_fake_page() as session:
            _, writer = await asyncio.open_connection("127.0.0.1", session.server.port)
            writer.write(b"GET / HT")
            await wait_until(lambda: session.server.num_connections == 1, "connection")
            writer.close()
            await wait_until(lambda: session.server.num_connections == 0, "its end")

    caplog.set_level(logging.WARNING)
    run_scenario(scenario())
    assert not caplog.records
