"""Server of the live page: one port for files and WebSockets.

The page is a client of the stream: the same peer, requests and limits with another codec and
socket, so that nothing works in a browser alone. aiohttp, since WebSockets, files and JSON then
share the event loop; its low-level server with tables of addresses instead of the router, since no
path of a request is ever opened. Loaded after the first frame, as the stream is: 0.2 s of processor
time and 13 MB, none with `--no-view`.

No request has a body, names a path of this machine, or lives long. A connection that is no
WebSocket makes room for newcomers.
"""

from __future__ import annotations

import asyncio
import logging
import re
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web

from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_server.runtime.faults import log_fault
from catoptra_server.serve.port import ConnectionLimits, Port, set_vanished_timeout
from catoptra_server.serve.stream.replies import StreamContext
from catoptra_server.serve.stream.session import INTERNAL_FAULT
from catoptra_server.serve.web.page_socket import (
    CLOSE_TIMEOUT_S,
    SECURITY_HEADERS,
    PageSocket,
    PageWebSocket,
    WebConnection,
    resource_response,
    text_response,
)
from catoptra_server.serve.web.pages import WebPages
from catoptra_server.serve.web.web_access import AccessDeniedError, WebAccess

log = logging.getLogger(__name__)
MAX_WEBSOCKETS = 64
_SOCKET_PATH = "/socket"
# Of a connection that is no WebSocket: loading the page takes less than a second.
_MAX_LIFETIME_S = 30.0
# A ping after this time without input, and a reply within half of that: a page that has vanished
# without closing the connection is noticed within 7.5 s.
_PING_INTERVAL_S = 5.0
# The kernel doubles this: a read of the smallest messages takes 3 ms, one of the largest is two.
_RECEIVE_BUFFER_BYTES = 16 * 1024


class WebServer:
    """A listening port and its connections."""

    def __init__(
        self,
        listener: socket.socket,
        context: StreamContext,
        pages: WebPages,
        *,
        access: WebAccess,
        limits: ConnectionLimits,
    ) -> None:
        """Begin to accept connections.

        Args:
            listener: Listening socket, which the server owns from now on.
            context: What the clients of the stream share.
            pages: What requests read.
            access: Who may use the port.
            limits: Number of connections, and time of the loop for their input.
        """
        self._loop = asyncio.get_running_loop()
        self._context = context
        self._pages = pages
        self._access = access
        self._limits = limits
        # aiohttp's part: a handler of requests for the protocol, one object a connection.
        self._server = web.Server(self._handle, handler_cancellation=True)
        self._tasks: set[asyncio.Task[None]] = set()
        self._port = Port(
            listener,
            self._open,
            name="view",
            limits=limits,
            first_bytes=re.compile(b"[A-Z]"),
            check=self._check,
        )

    @property
    def port(self) -> int:
        """TCP port on which the server listens."""
        return self._port.number

    @property
    def num_connections(self) -> int:
        """Number of open connections."""
        return len(self._port)

    @property
    def sockets(self) -> tuple[PageSocket, ...]:
        """Open WebSockets."""
        return tuple(one.page for one in self._port if one.page is not None)

    async def close(self) -> None:
        """Release the port and end every connection."""
        self._port.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for connection in self._port:
            connection.end()
        await self._server.shutdown(CLOSE_TIMEOUT_S)
        self._pages.close()

    def _open(self, accepted: socket.socket, address: str) -> WebConnection:
        set_vanished_timeout(accepted)
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        connection = WebConnection(
            self._server,
            address=address,
            account=self._limits.loop_share.open_account(address),
            opened_at_s=self._loop.time(),
            on_lost=self._port.remove,
        )
        task = self._loop.create_task(self._connect(connection, accepted))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return connection

    async def _connect(self, connection: WebConnection, accepted: socket.socket) -> None:
        try:
            await self._loop.connect_accepted_socket(lambda: connection, accepted)
        except OSError as error:
            log.info("web connection of %s closed: %s", connection.address, error)
            self._port.remove(connection)
            accepted.close()

    def _check(self, connection: WebConnection, now_s: float) -> str:
        """Reason to end a connection that lives too long, or reads nothing; empty for none."""
        if connection.page is not None:
            connection.page.check()
            return ""
        is_overdue = connection.opened_at_s < now_s - _MAX_LIFETIME_S
        return f"no WebSocket within {_MAX_LIFETIME_S:g} s" if is_overdue else ""

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        connection = request.protocol
        assert isinstance(connection, WebConnection), "all connections are of this class"
        await connection.begin_request()
        response = await self._respond(request, connection)
        connection.note_reply()
        return response

    async def _respond(
        self, request: web.BaseRequest, connection: WebConnection
    ) -> web.StreamResponse:
        try:
            self._check_access(request)
        except AccessDeniedError as error:
            log.warning("a page request of %s was refused: %s", connection.address, error)
            return text_response(403, str(error))
        token = request.query.get("token")
        if self._access.token is not None and token is not None and request.path == "/":
            return self._welcome(token)
        if request.method not in ("GET", "HEAD"):
            return text_response(405, "only GET is served", headers={"Allow": "GET, HEAD"})
        if request.body_exists:
            # Not read: the connection ends after the response.
            response = text_response(413, "a request has no body here")
            response.force_close()
            return response
        if request.path == _SOCKET_PATH:
            return await self._serve_socket(request, connection)
        try:
            resource = await self._pages.find(request.path, request.query)
        except Exception:
            log_fault(log, "a page request of %s failed", request.path[:80])
            return text_response(500, INTERNAL_FAULT)
        if resource is None:
            return text_response(404, "there is nothing at this address")
        return resource_response(resource, known_tags=request.headers.get("If-None-Match", ""))

    def _check_access(self, request: web.BaseRequest) -> None:
        """Raise AccessDeniedError for a request that is not of this server's page."""
        access, headers = self._access, request.headers
        hosts, origins = headers.getall("Host", []), headers.getall("Origin", [])
        if len(hosts) != 1 or len(origins) > 1 or not request.raw_path.startswith("/"):
            raise AccessDeniedError("a request has one Host header, one Origin at most, and a path")
        access.check_headers(
            hosts[0],
            origins[0] if origins else None,
            needs_origin=request.path == _SOCKET_PATH,
        )
        token = request.cookies.get(access.cookie_name)
        if request.path == "/":
            token = request.query.get("token", token)
        access.check_token(token)

    def _welcome(self, token: str) -> web.StreamResponse:
        """Exchange the token of the link for a cookie: no shown address has the token then."""
        cookie = f"{self._access.cookie_name}={token}; HttpOnly; SameSite=Strict; Path=/"
        return text_response(303, "see /", headers={"Location": "/", "Set-Cookie": cookie})

    async def _serve_socket(
        self, request: web.BaseRequest, connection: WebConnection
    ) -> web.StreamResponse:
        websocket = PageWebSocket(
            timeout=CLOSE_TIMEOUT_S,
            autoping=False,  # counted like all other messages
            heartbeat=_PING_INTERVAL_S,
            compress=False,  # pictures are compressed, and each page would cost a deflate
            max_msg_size=MAX_REQUEST_BYTES + 1,  # aiohttp's limit is exclusive
            writer_limit=1,  # a message is sent once the kernel has most bytes
        )
        websocket.headers.update(SECURITY_HEADERS)
        try:
            await websocket.prepare(request)
        except web.HTTPException as error:
            return text_response(error.status, "this address is a WebSocket")
        connection.page = PageSocket(websocket, connection, self._context)
        await connection.page.serve()
        return websocket


@asynccontextmanager
async def serve_web(
    listener: socket.socket,
    context: StreamContext,
    pages: WebPages,
    *,
    access: WebAccess,
    limits: ConnectionLimits,
) -> AsyncIterator[WebServer]:
    """Serve the page until the block ends; for the arguments see WebServer."""
    server = WebServer(listener, context, pages, access=access, limits=limits)
    try:
        yield server
    finally:
        await server.close()
