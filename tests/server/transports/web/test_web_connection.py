"""One connection of the web port: held back when it sends too much, its errors contained."""

from __future__ import annotations

import asyncio
import logging

import pytest

from catoptra_protocol.stream.requests import GetStatusRequest
from catoptra_server.transports.web.web_connection import WebConnection
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


def test_flood_of_messages_is_held_back_and_another_page_is_not() -> None:
    async def scenario() -> None:
        async with (
            serve_fake_page() as session,
            session.open_socket() as other,
            session.open_socket() as flooding,
        ):
            for _ in range(2000):
                await flooding.websocket.send_str("{}")
            for number in range(1, 100):
                await other.request(GetStatusRequest(number))
            assert [one._hold is not None for one in session.server._connections] == [False, True]

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
