"""The web port over the loopback: access, documents, limits of connections."""

from __future__ import annotations

import asyncio
import dataclasses
import logging

import aiohttp
import pytest

from catoptra_protocol.stream.replies import StatusReply
from catoptra_protocol.stream.requests import GetStatusRequest
from catoptra_server.serve import port as port_module
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.web import pages as pages_module
from catoptra_server.serve.web import web_server
from catoptra_server.serve.web.page_socket import SECURITY_HEADERS
from catoptra_server.serve.web.web_access import WebAccess
from helpers.live_page import FILES, PageSession, serve_fake_page
from helpers.loopback import connect, wait_until


async def send_raw(session: PageSession, request: bytes) -> bytes:
    """All bytes of the response to raw bytes, up to the end of the connection."""
    reader, writer = await connect(session.server)
    writer.write(request)
    response = await reader.read()
    writer.close()
    return response


def protect(access: WebAccess) -> WebAccess:
    return dataclasses.replace(access, host_names=frozenset(), token="secret")


async def test_page_and_its_files_have_types_tags_and_security_headers() -> None:
    async with serve_fake_page() as session:
        for path, document in FILES.items():
            response = await session.get(path)
            assert response.status == 200
            assert await response.text() == document.body.decode()
            assert response.headers["Content-Type"] == document.content_type
            assert dict(response.headers).items() >= SECURITY_HEADERS.items()
            again = await session.get(path, If_None_Match=response.headers["ETag"])
            assert again.status == 304
            assert again.headers.get("Content-Length", "0") == "0"
            assert dict(again.headers).items() >= SECURITY_HEADERS.items()


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "/missing", {}, 404),
        ("GET", "/static/../main.js", {}, 404),
        ("GET", "/static/%2e%2e/%2e%2e/web_server.py", {}, 404),
        ("GET", "/static/..%2fpage_files.py", {}, 404),
        ("GET", "/api/camera_table.json", {}, 404),
        ("GET", "/socket", {}, 403),
        ("POST", "/", {}, 405),
        ("PUT", "/static/main.js", {}, 405),
        ("DELETE", "/api/server.json", {}, 405),
        ("OPTIONS", "/", {}, 405),
        ("GET", "/", {"Host": "evil.example"}, 403),
        ("GET", "/", {"Origin": "http://evil.example"}, 403),
        ("GET", "/api/server.json", {"Origin": "null"}, 403),
    ],
)
async def test_request_when_it_is_not_served_has_a_reason_and_all_security_headers(
    method: str, path: str, headers: dict[str, str], status: int
) -> None:
    async with serve_fake_page() as session:
        address = f"{session.url}{path}"
        url = aiohttp.client.URL(address, encoded=True)
        async with session.http.request(method, url, headers=headers) as response:
            assert response.status == status
            assert dict(response.headers).items() >= SECURITY_HEADERS.items()
            assert response.headers["Content-Type"].startswith("text/plain")
            assert await response.text()
        # The connection, and the server, go on.
        assert (await session.get("/")).status == 200


async def test_head_has_the_headers_alone() -> None:
    async with serve_fake_page() as session:
        async with session.http.head(f"{session.url}/static/main.js") as response:
            assert response.status == 200
            assert response.headers["Content-Length"] == str(len(FILES["/static/main.js"].body))
            assert await response.read() == b""


async def test_body_of_a_request_is_rejected() -> None:
    async with serve_fake_page() as session:
        async with session.http.get(f"{session.url}/", data=b"x" * 100) as response:
            assert response.status == 413
        assert (await session.get("/")).status == 200


# Raw bytes of a request, and the status of the response.
HOST = b"Host: 127.0.0.1\r\n"
MALFORMED = {
    "garbage": (b"\x16\x03\x01\x02\r\n\r\n", b" 400 "),
    "no host": (b"GET / HTTP/1.0\r\n\r\n", b" 403 "),
    "two hosts": (b"GET / HTTP/1.0\r\n" + HOST + HOST + b"\r\n", b" 400 "),
    "address of another": (b"GET http://evil/ HTTP/1.0\r\n" + HOST + b"\r\n", b" 403 "),
    "long path": (b"GET /" + 5000 * b"a" + b" HTTP/1.0\r\n" + HOST + b"\r\n", b" 400 "),
    "long field": (
        b"GET / HTTP/1.0\r\nCookie: " + 9000 * b"a" + b"\r\n" + HOST + b"\r\n",
        b" 400 ",
    ),
    "many fields": (
        b"GET / HTTP/1.0\r\n" + HOST + b"".join(b"A%d: b\r\n" % n for n in range(100)) + b"\r\n",
        b" 400 ",
    ),
}


@pytest.mark.parametrize(("request_", "status"), MALFORMED.values(), ids=MALFORMED.keys())
async def test_request_when_malformed_is_rejected_without_a_traceback(
    request_: bytes, status: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    async with serve_fake_page() as session:
        response = await send_raw(session, request_)
        assert response[8:13] == status, response[:200]
        assert b"Content-Security-Policy: default-src 'self'" in response
        assert b"aiohttp" not in response
        assert (await session.get("/")).status == 200
    assert "Traceback" not in caplog.text


async def test_refusal_is_logged_with_its_reason(caplog: pytest.LogCaptureFixture) -> None:
    async with serve_fake_page() as session:
        await session.get("/", Host="evil.example")
    (record,) = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert "names another host" in record.getMessage()


@pytest.mark.parametrize(
    "headers", [{}, {"Origin": "http://evil.example"}, {"Origin": "null"}], ids=str
)
async def test_websocket_of_another_site_is_refused(headers: dict[str, str]) -> None:
    async with serve_fake_page() as session:
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            await session.http.ws_connect(f"{session.url}/socket", headers=headers)
        assert not session.server.sockets


async def test_socket_when_it_is_read_as_a_page_is_an_error() -> None:
    async with serve_fake_page() as session:
        response = await session.get("/socket", Origin=session.url)
        assert response.status == 400
        assert dict(response.headers).items() >= SECURITY_HEADERS.items()


async def test_token_of_the_link_becomes_a_cookie_and_leaves_the_address() -> None:
    async with serve_fake_page(access=protect) as session:
        assert (await session.get("/")).status == 403
        assert (await session.get("/static/main.js")).status == 403
        assert (await session.get("/?token=wrong")).status == 403
        assert (await session.get("/static/main.js?token=secret")).status == 403
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            await session.http.ws_connect(f"{session.url}/socket", origin=session.url)
        welcome = await session.get("/?token=secret")
        assert (welcome.status, welcome.headers["Location"]) == (303, "/")
        cookie = welcome.headers["Set-Cookie"]
        assert cookie.startswith(f"{session.access.cookie_name}=secret; ")
        assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
        # aiohttp's client keeps the cookie, as a browser does.
        for path in FILES:
            assert (await session.get(path)).status == 200
        assert (await session.get("/", Host="10.0.0.7:5080")).status == 200
        async with session.open_socket() as page:
            assert isinstance(await page.request(GetStatusRequest(1)), StatusReply)
        cookie = f"{session.access.cookie_name}=guess"
        session.http.cookie_jar.clear()
        assert (await session.get("/", Cookie=cookie)).status == 403


async def test_description_when_it_fails_is_an_error_without_the_traceback(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_: object) -> object:
        raise ZeroDivisionError("injected")

    monkeypatch.setattr(pages_module, "describe_server", fail)
    async with serve_fake_page() as session:
        response = await session.get("/api/server.json")
        assert response.status == 500
        assert "injected" not in await response.text()
        assert (await session.get("/")).status == 200
    assert "injected" in caplog.text


async def test_connection_without_a_whole_request_ends_after_its_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(web_server, "_MAX_LIFETIME_S", 0.2)
    async with serve_fake_page() as session:
        reader, writer = await connect(session.server)
        async with session.open_socket() as page:
            writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")
            await wait_until(lambda: session.server.num_connections == 2, "both connections")
            assert await reader.read() == b""
            # A WebSocket lives on.
            assert isinstance(await page.request(GetStatusRequest(1)), StatusReply)
        writer.close()


async def test_request_without_an_end_is_closed_at_64_kib(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    async with serve_fake_page() as session:
        reader, writer = await connect(session.server)
        # Line ends before a request are skipped by the parser, however many.
        try:
            while not reader.at_eof():
                writer.write(4096 * b"\r\n")
                await writer.drain()
        except ConnectionError:
            pass
        writer.close()
    assert "its request has no end" in caplog.text


async def test_newcomer_at_the_limit_takes_the_place_of_the_oldest_that_is_no_websocket() -> None:
    async with serve_fake_page(limits=ConnectionLimits(max_connections=3)) as session:
        async with session.open_socket() as page:
            first, first_writer = await connect(session.server)
            second, second_writer = await connect(session.server)
            await wait_until(lambda: session.server.num_connections == 3, "three connections")
            assert (await session.get("/")).status == 200
            assert await first.read() == b""
            assert not second.at_eof()
            assert isinstance(await page.request(GetStatusRequest(1)), StatusReply)
            first_writer.close()
            second_writer.close()


async def test_thousand_connections_leave_a_page_undisturbed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Otherwise the flood takes a minute: 20 connections a second are opened.
    monkeypatch.setattr(port_module, "MAX_OPENED_PER_S", 1e6)
    async with serve_fake_page(limits=ConnectionLimits(max_connections=8)) as session:
        async with session.open_socket() as page:
            writers = []
            for number in range(1000):
                _, writer = await connect(session.server)
                writer.write(b"GET / HTTP/1.1\r\n")
                writers.append(writer)
                assert session.server.num_connections <= 8
                if number % 50 == 0:
                    header, _ = await page.get_frame()
                    assert header.dropped_frames == 0
            for writer in writers:
                writer.close()
            assert (await session.get("/")).status == 200


async def test_server_when_it_ends_closes_pages_at_once() -> None:
    async with serve_fake_page() as session:
        websocket = await session.http.ws_connect(f"{session.url}/socket", origin=session.url)
        _, idle_writer = await connect(session.server)
        await wait_until(lambda: session.server.num_connections == 2, "both connections")
        await session.server.close()
        message = await websocket.receive()
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        idle_writer.close()
        await wait_until(lambda: not session.server.num_connections, "all ends")


async def test_flood_of_requests_of_one_peer_leaves_others_undisturbed() -> None:
    async with serve_fake_page() as session:
        _, writer = await connect(session.server)
        request = b"GET /missing HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        writer.write(2000 * request)
        async with session.open_socket() as page:
            for _ in range(20):
                await page.get_frame()
        # Held back: far fewer than sent are served in that time.
        assert session.server._server.requests_count < 1000
        writer.close()
        await asyncio.sleep(0)
