"""A live page over the loopback: a server of a fake simulation, and a client of its WebSocket."""

from __future__ import annotations

import itertools
import re
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import aiohttp

from catoptra_protocol.stream.messages import json_from_message, reply_from_json
from catoptra_protocol.stream.replies import FrameHeader, Reply
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding, Request
from catoptra_server.serve.port import ConnectionLimits, create_listener
from catoptra_server.serve.web.pages import WebPages, WebResource
from catoptra_server.serve.web.web_access import WebAccess, create_web_access
from catoptra_server.serve.web.web_server import WebServer
from catoptra_server.world.scene_mesh import build_scene
from helpers.fake_simulation import SERVER_INFO, FakeSimulation, create_fake_context
from helpers.loopback import HOST
from helpers.server_process import RunningServer
from helpers.worlds import make_test_world

FILES: Mapping[str, WebResource] = {
    "/": WebResource.from_body("text/html; charset=utf-8", b"<!DOCTYPE html>"),
    "/static/main.js": WebResource.from_body("text/javascript; charset=utf-8", b"export {};"),
}


@dataclass
class PageSession:
    """A server of the page, an HTTP client, and what the simulation receives."""

    server: WebServer
    access: WebAccess
    simulation: FakeSimulation
    http: aiohttp.ClientSession
    ids: itertools.count[int] = field(default_factory=lambda: itertools.count(1))

    @property
    def url(self) -> str:
        """Address of the page, without a path."""
        return f"http://{HOST}:{self.server.port}"

    async def get(self, path: str, **headers: str) -> aiohttp.ClientResponse:
        """Response to a GET request, its body read; `_` in the names of headers stands for `-`."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        async with self.http.get(self.url + path, headers=named, allow_redirects=False) as response:
            await response.read()
            return response

    @asynccontextmanager
    async def open_socket(self) -> AsyncIterator[PageClient]:
        """Open a WebSocket as the page does."""
        async with self.http.ws_connect(f"{self.url}/socket", origin=self.url) as websocket:
            yield PageClient(websocket, self.ids)


@dataclass
class PageClient:
    """One WebSocket; `ids` numbers its requests."""

    websocket: aiohttp.ClientWebSocketResponse
    ids: itertools.count[int] = field(default_factory=lambda: itertools.count(1))

    async def send(self, request: Request) -> None:
        """Send a request."""
        await self.websocket.send_str(json_from_message(request))

    async def receive(self) -> tuple[Reply, bytes]:
        """Next reply, with the image of a frame."""
        message = await self.websocket.receive()
        if message.type is aiohttp.WSMsgType.TEXT:
            reply = reply_from_json(message.data)
            assert reply is not None
            return reply, b""
        assert message.type is aiohttp.WSMsgType.BINARY, message
        length = int.from_bytes(message.data[:4], "little")
        header = reply_from_json(message.data[4 : 4 + length].decode())
        assert isinstance(header, FrameHeader)
        return header, message.data[4 + length :]

    async def request(self, request: Request) -> Reply:
        """Send a request; its reply."""
        await self.send(request)
        reply, _ = await self.receive()
        assert getattr(reply, "id", None) == request.id
        return reply

    async def request_frame(self, encoding: ImageEncoding = ImageEncoding.RAW) -> int:
        """Send a request for a frame; its id."""
        id_ = next(self.ids)
        await self.send(GetFrameRequest(id_, "", "", encoding))
        return id_

    async def get_frame(
        self, encoding: ImageEncoding = ImageEncoding.RAW
    ) -> tuple[FrameHeader, bytes]:
        """Header and image of the next frame."""
        await self.request_frame(encoding)
        header, image = await self.receive()
        assert isinstance(header, FrameHeader), header
        return header, image


def read_page_link(server: RunningServer) -> str:
    """Address of a server's page without the last slash; once, of one started with `--view`."""
    assert server.process.stdout is not None, "stdout is a pipe"
    line = server.process.stdout.readline()
    found = re.fullmatch(r"live page: (http://127\.0\.0\.1:\d+)/\n", line)
    assert found, f"the server printed no address of a live page: {line!r}"
    return found[1]


@asynccontextmanager
async def serve_fake_page(
    simulation: FakeSimulation | None = None,
    *,
    access: Callable[[WebAccess], WebAccess] = lambda access: access,
    limits: ConnectionLimits | None = None,
) -> AsyncIterator[PageSession]:
    """Serve a page of a fake simulation on a free port.

    Args:
        simulation: The simulation.
        access: Changes the rules of access.
        limits: Limits of the connections.
    """
    simulation = simulation or FakeSimulation()
    listener = create_listener(HOST, 0, name="view")
    rules = access(create_web_access(HOST, listener))
    server = WebServer(
        listener,
        create_fake_context(simulation),
        WebPages(FILES, SERVER_INFO, build_scene(make_test_world())),
        access=rules,
        limits=limits or ConnectionLimits(),
    )
    # Cookies of addresses, too: aiohttp's default keeps none of 127.0.0.1.
    cookies = aiohttp.CookieJar(unsafe=True)
    try:
        async with aiohttp.ClientSession(cookie_jar=cookies) as http:
            yield PageSession(server, rules, simulation, http)
    finally:
        await server.close()
