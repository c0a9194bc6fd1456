"""One connection of the web port, and the WebSocket that one may become: a client of the stream.

The messages of a WebSocket are JSON (SPEC.md 10). Text messages are requests and replies; a frame
is one binary message: the length of the header as 4 bytes, the least significant first, the header,
the image. A connection that sends too much is not read for a while.

**A robot that a page drives needs its hand.** 0.25 s without `drive` halt it, since a page that is
hidden, frozen or cut off sends nothing. Programs keep USARSim's rule unless they ask for this one.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from http import HTTPStatus
from typing import Any

from aiohttp import WebSocketError, WSMsgType, web

from catoptra_protocol.errors import InvalidRequestError, RemoteProtocolError
from catoptra_protocol.json_object import text_from_json_object
from catoptra_protocol.stream.codec import FieldMap, plain_value
from catoptra_protocol.stream.messages import request_from_json
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import DriveRequest
from catoptra_server.frames.frame import Payload
from catoptra_server.runtime.faults import log_fault
from catoptra_server.serve.limits import MAX_BLOCKED_S, NEWCOMER_AGE_S, LoopAccount
from catoptra_server.serve.stream.peer import StreamPeer
from catoptra_server.serve.stream.replies import StreamContext
from catoptra_server.serve.stream.router import Outbox, SendResult
from catoptra_server.serve.stream.session import INTERNAL_FAULT
from catoptra_server.serve.web.pages import WebResource

log = logging.getLogger(__name__)
# Scripts, styles and sockets of this address alone, in no frame of another page, sniffed as no
# other type, readable by no other site. The last one hides the versions that aiohttp names.
SECURITY_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "Catoptra",
}
# Kept by browsers, but used only after the server has confirmed that it is the newest.
_REVALIDATED = {"Cache-Control": "no-cache"}
# Until the peer has ended, too.
CLOSE_TIMEOUT_S = 1.0
# A driving page sends 20 requests a second.
_DRIVE_TIMEOUT_S = 0.25
# Time of the loop for a read beside the parser's, and for a request with a reply.
_READ_COST_S = 50e-6
_REQUEST_COST_S = 0.4e-3
# Requests of a page on their way at any time: frame, state and landmarks. Each waits for the reply
# to the last one of its kind, so together they are no flood.
_MAX_DIALOGUE = 3
# All bytes of a request: browsers send some hundred, and the cookies of all ports of the host.
_MAX_REQUEST_BYTES = 64 * 1024
_MAX_LINE_BYTES = 4 * 1024
_MAX_FIELD_BYTES = 8 * 1024
_MAX_FIELDS = 64
_LENGTH_BYTES = 4


class PageSocket:
    """A WebSocket from the handshake to the end."""

    def __init__(
        self, websocket: web.WebSocketResponse, connection: WebConnection, context: StreamContext
    ) -> None:
        """Begin without a robot.

        Args:
            websocket: The WebSocket, after the handshake, with `autoping` off.
            connection: Its connection.
            context: What the clients of the server share.
        """
        self._loop = asyncio.get_running_loop()
        self._websocket = websocket
        self._connection = connection
        # One message is being sent; all others wait in the outbox, within bounds.
        self._sending: asyncio.Task[None] | None = None
        self._sending_since_s = 0.0
        outbox = Outbox(
            self._send,
            on_blocked=lambda: None,  # the end of each message sends the next
            on_overflow=self._disconnect,
        )
        self.peer = StreamPeer(
            outbox,
            context,
            address=connection.address,
            account=connection.account,
            encode=_encode_fields,
        )

    async def serve(self) -> None:
        """Reply to requests until the WebSocket ends; removes the robot then."""
        log.info("page %s connected", self._connection.address)
        try:
            while await self._receive():
                pass
        # The connection's own end, while something is sent.
        except ConnectionError:
            pass
        finally:
            self._close()
            num_sent = self.peer.frame_sender.num_sent
            log.info("page %s disconnected after %d frames", self._connection.address, num_sent)

    def check(self) -> None:
        """End a WebSocket that reads nothing; to be called regularly."""
        is_sending = self._sending is not None
        sending_s = self._loop.time() - self._sending_since_s
        if self.peer.has_stalled_outbox() or (is_sending and sending_s > MAX_BLOCKED_S):
            self._disconnect()

    def _close(self) -> None:
        self.peer.disconnect()
        if self._sending is not None:
            self._sending.cancel()
        # Not left to aiohttp, which would wait until all is read.
        self._connection.end()

    def _disconnect(self) -> None:
        if not self._connection.is_closing:
            log.warning("page %s reads nothing: disconnected", self._connection.address)
            self._connection.end()

    async def _receive(self) -> bool:
        """Handle one message; False at the end."""
        message = await self._websocket.receive()
        # Input of a connection that was ended is dropped: replies would fill the outbox.
        if self._connection.is_closing:
            return False
        if isinstance(message.data, WebSocketError):
            self.peer.disconnect()  # a reply behind the close frame would fail, and end all at once
            # aiohttp drops what follows a faulty frame. Unread it would reset the connection, and
            # the reset, or an end of the stream, overtake the close frames. The peer's end cancels.
            await asyncio.sleep(CLOSE_TIMEOUT_S)
        if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY, WSMsgType.PING, WSMsgType.PONG):
            return False
        await self._connection.begin_request()
        match message.type:
            case WSMsgType.TEXT:
                self._handle_text(message.data)
            case WSMsgType.BINARY:
                self.peer.send_reply(Error(0, "a binary message: requests are JSON text"))
            case WSMsgType.PING:
                await self._websocket.pong(message.data)
                self._connection.note_reply()
        return True

    def _handle_text(self, text: str) -> None:
        try:
            request = request_from_json(text)
        except RemoteProtocolError as error:
            log.debug("from page %s: %s", self._connection.address, error)
            id_ = error.request_id if isinstance(error, InvalidRequestError) else 0
            self.peer.send_reply(Error(id_, str(error)))
            return
        except Exception:
            log_fault(log, "a message of a page failed")
            self.peer.send_reply(Error(0, INTERNAL_FAULT))
            return
        log.debug("from page %s: %s", self._connection.address, request)
        if isinstance(request, DriveRequest) and request.halt_after_s is None:
            request = replace(request, halt_after_s=_DRIVE_TIMEOUT_S)
        self.peer.serve(request)

    def _send(self, parts: list[Payload]) -> SendResult:
        if self._sending is not None:
            return SendResult.QUEUE_FULL
        self._sending_since_s = self._loop.time()
        self._sending = self._loop.create_task(self._write(parts))
        self._sending.add_done_callback(self._finish_sending)
        return SendResult.SENT

    async def _write(self, parts: list[Payload]) -> None:
        if len(parts) == 1:
            await self._websocket.send_frame(bytes(parts[0]), WSMsgType.TEXT)
            return
        header, *payloads = parts
        length = len(header).to_bytes(_LENGTH_BYTES, "little")
        await self._websocket.send_frame(b"".join((length, header, *payloads)), WSMsgType.BINARY)

    def _finish_sending(self, task: asyncio.Task[None]) -> None:
        self._sending = None
        self._connection.note_reply()
        if task.cancelled():
            return
        error = task.exception()
        if error is None:
            self.peer.outbox.flush()
        else:
            # The connection has ended, mostly, as is noticed by `_receive`.
            log.debug("page %s: not sent: %s", self._connection.address, error)
            self._connection.end()


def _encode_fields(fields: FieldMap) -> bytes:
    return text_from_json_object(fields, default=plain_value).encode()


class PageWebSocket(web.WebSocketResponse):
    """A WebSocket whose connection `PageSocket` ends: aiohttp would do so with input unread."""

    def _close_transport(self) -> None:
        pass


class MaskCheck:
    """Whether all frames of a browser are masked (RFC 6455 5.1), which aiohttp does not check."""

    def __init__(self) -> None:
        self._head = bytearray()
        self._num_body_bytes = 0

    def feed(self, data: bytes) -> bool:
        """Check the next bytes; False for a frame without a mask."""
        position = 0
        while position < len(data):
            if self._num_body_bytes:
                passed = min(self._num_body_bytes, len(data) - position)
                self._num_body_bytes -= passed
                position += passed
                continue
            self._head.append(data[position])
            position += 1
            if len(self._head) < 2:
                continue
            if not self._head[1] & 0x80:
                return False
            length = self._head[1] & 0x7F
            num_length_bytes = {126: 2, 127: 8}.get(length, 0)
            if len(self._head) == 2 + num_length_bytes + 4:
                if num_length_bytes:
                    length = int.from_bytes(self._head[2 : 2 + num_length_bytes], "big")
                self._num_body_bytes = length
                self._head.clear()
        return True


class WebConnection(web.RequestHandler):
    """HTTP requests of one connection, which may become a WebSocket."""

    def __init__(
        self,
        server: web.Server,
        *,
        address: str,
        account: LoopAccount,
        opened_at_s: float,
        on_lost: Callable[[WebConnection], object],
    ) -> None:
        """Create the protocol of a socket that is about to be connected to a transport.

        Args:
            server: Has the handler of requests.
            address: Address of the peer, for logs.
            account: Use of the event loop.
            opened_at_s: Time of the connection.
            on_lost: Called once when the connection ends.
        """
        loop = asyncio.get_running_loop()
        super().__init__(
            server,
            loop=loop,
            tcp_keepalive=False,  # the port has set this
            access_log=None,  # type: ignore[arg-type] # None is no log
            logger=log,
            max_line_size=_MAX_LINE_BYTES,
            max_field_size=_MAX_FIELD_BYTES,
            max_headers=_MAX_FIELDS,
            lingering_time=0.0,  # no request has a body that would be read to the end
        )
        self.address = address
        self.opened_at_s = opened_at_s
        self.page: PageSocket | None = None
        """The WebSocket that the connection has become."""
        self.account = account
        """Use of the event loop, and of the renderer."""
        self._on_lost = on_lost
        self._open_loop = loop
        self._hold: asyncio.TimerHandle | None = None
        self._mask_check = MaskCheck()
        self._requested_at_s = -math.inf
        self._num_request_bytes = 0
        self._num_messages = 0
        self._num_unanswered = 0

    def data_received(self, data: bytes) -> None:
        """Parse input, and read no more for a while once too much of the loop was used."""
        self._num_messages = 0
        self._num_request_bytes += len(data)
        if self.page is None and self._num_request_bytes > _MAX_REQUEST_BYTES:
            log.info("web connection of %s closed: its request has no end", self.address)
            self.end()
            return
        if self.page is not None and not self._mask_check.feed(data):
            log.info("web connection of %s closed: a frame without a mask", self.address)
            self.end()
            return
        begin_s = time.thread_time()
        super().data_received(data)
        self._charge(_READ_COST_S + time.thread_time() - begin_s)

    async def begin_request(self) -> None:
        """Charge a request or a message, and wait until the connection may use the loop again."""
        self._requested_at_s = self._open_loop.time()
        self._num_messages += 1
        self._num_unanswered += 1
        self._num_request_bytes = 0
        self._charge(_REQUEST_COST_S)
        await self.account.wait()

    def _charge(self, duration_s: float) -> None:
        # A peer that waits for replies occupies the loop with few requests at any time.
        self.account.charge(duration_s, is_dialogue=self._is_dialogue)
        self._hold_back()

    def note_reply(self) -> None:
        """Record that something was sent."""
        self._num_unanswered = max(self._num_unanswered - 1, 0)

    @property
    def _is_dialogue(self) -> bool:
        """Whether the peer waits for replies; one may be sent that is not noted yet."""
        return self._num_unanswered <= _MAX_DIALOGUE + 1 and self._num_messages <= _MAX_DIALOGUE

    @property
    def has_handshake(self) -> bool:
        """Whether the peer has sent a whole request."""
        return self._requested_at_s > -math.inf

    @property
    def has_left(self) -> bool:
        """Whether nothing more is sent."""
        return self.is_closing and self._requested_at_s > -math.inf

    @property
    def is_in_use(self) -> bool:
        """Whether the page has a robot, or has requested something a moment ago."""
        has_robot = self.page is not None and self.page.peer.robot.has_robot
        is_recent = self._open_loop.time() - self._requested_at_s < NEWCOMER_AGE_S
        return has_robot or (self.page is not None and is_recent)

    @property
    def is_closing(self) -> bool:
        """Whether nothing more is sent."""
        return self.transport is None or self.transport.is_closing()

    def end(self) -> None:
        """Close the connection at once; bytes that the peer has not read are dropped."""
        if self.transport is not None:
            self.transport.abort()

    def log_exception(self, *args: Any, **kw: Any) -> None:
        """Log an exception that aiohttp has caught."""
        log_fault(log, "a web request of %s failed", self.address)

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = HTTPStatus.INTERNAL_SERVER_ERROR,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """Response to a request that aiohttp cannot parse, and to one whose handler failed."""
        if status == HTTPStatus.INTERNAL_SERVER_ERROR:
            self.log_exception()
            reason = INTERNAL_FAULT
        else:
            # The peer's fault: no traceback, which a peer could cause at will.
            reason = "not a valid HTTP request"
            log.info("web connection of %s closed: %s", self.address, reason)
        response = text_response(status, reason)
        response.force_close()
        return response

    def _hold_back(self) -> None:
        wait_s = self.account.remaining_wait_s
        if wait_s > 0.0 and self._hold is None and self.transport is not None:
            self.transport.pause_reading()
            self._hold = self._open_loop.call_later(wait_s, self._release)

    def _release(self) -> None:
        self._hold = None
        if not (self._reading_paused or self._buffer_paused):
            self._resume_transport_reading()

    def _resume_transport_reading(self) -> None:
        # By aiohttp, when there is room again; the hold goes on all the same.
        if self._hold is None:
            super()._resume_transport_reading()

    def connection_lost(self, exc: BaseException | None) -> None:
        """Record the end; called by asyncio."""
        if self._hold is not None:
            self._hold.cancel()
        self._on_lost(self)
        super().connection_lost(exc)


def text_response(
    status: int, reason: str, *, headers: Mapping[str, str] | None = None
) -> web.Response:
    """Response with a reason in plain text."""
    return web.Response(
        status=status,
        body=f"{reason}\n".encode(),
        headers={
            **SECURITY_HEADERS,
            "Content-Type": "text/plain; charset=utf-8",
            "Cache-Control": "no-store",
            **(headers or {}),
        },
    )


def resource_response(resource: WebResource, *, known_tags: str) -> web.Response:
    """Response with a resource, or without the body for a client that has an equal one.

    Args:
        resource: The resource.
        known_tags: If-None-Match header of the request; empty if absent.
    """
    headers = {**SECURITY_HEADERS, **_REVALIDATED, "ETag": resource.etag}
    # Compared weakly, as in RFC 9110 13.1.2.
    tags = {tag.strip().removeprefix("W/") for tag in known_tags.split(",")}
    if tags & {resource.etag, "*"}:
        return web.Response(status=304, headers=headers)
    headers["Content-Type"] = resource.content_type
    return web.Response(body=resource.body, headers=headers)
