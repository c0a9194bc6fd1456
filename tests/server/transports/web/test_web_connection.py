"""One connection of the web port: held back when it sends too much, its errors contained."""

from __future__ import annotations

import asyncio
import logging

import pytest

from catoptra_protocol.stream.requests import GetStateRequest, GetStatusRequest
from catoptra_server.serve.limits import LoopShare
from catoptra_server.serve.web.page_socket import PageSocket, WebConnection
from helpers.fake_simulation import FakeSimulation
from helpers.live_page import PageSession, serve_fake_page
from helpers.loopback import run_scenario, wait_until


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
