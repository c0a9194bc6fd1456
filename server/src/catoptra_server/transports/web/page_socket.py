"""One WebSocket of the page: a client of the stream whose messages are JSON (SPEC.md 10).

Text messages are requests and replies; a frame is one binary message: the length of its header as
4 bytes, the least significant first, the header, the image.
"""

from __future__ import annotations

import asyncio
import logging

from aiohttp import WSMsgType, web

from catoptra_protocol.errors import InvalidRequestError, RemoteProtocolError
from catoptra_protocol.stream.messages import json_from_message, request_from_json
from catoptra_protocol.stream.replies import Error, Reply
from catoptra_protocol.stream.requests import DriveRequest
from catoptra_server.frames.encode import Payload
from catoptra_server.runtime.faults import log_fault
from catoptra_server.transports.stream.outbox import Outbox, SendResult
from catoptra_server.transports.stream.pending_requests import INTERNAL_FAULT
from catoptra_server.transports.stream.stream_context import StreamContext
from catoptra_server.transports.stream.stream_peer import StreamPeer
from catoptra_server.transports.web.dead_man_switch import DeadManSwitch
from catoptra_server.transports.web.web_connection import WebConnection

log = logging.getLogger(__name__)

_LENGTH_BYTES = 4
# A message that the page has not read after this time ends its WebSocket; TCP ends it at the same
# time where its host has vanished.
_MAX_SENDING_S = 6.0


class PageSocket:
    """A WebSocket from the handshake to its end."""

    def __init__(
        self, websocket: web.WebSocketResponse, connection: WebConnection, context: StreamContext
    ) -> None:
        """Begin without a robot.

        Args:
            websocket: The WebSocket, after its handshake, with `autoping` off.
            connection: Its connection.
            context: What the clients of the server share.
        """
        self._loop = asyncio.get_running_loop()
        self._websocket = websocket
        self._connection = connection
        # One message is being sent; all others wait in the outbox, within its bounds.
        self._sending: asyncio.Task[None] | None = None
        self._sending_since_s = 0.0
        outbox = Outbox(
            self._send,
            on_blocked=lambda: None,  # the end of each message sends the next
            on_overflow=self._disconnect,
        )
        self.peer = StreamPeer(outbox, context, encode=_encode_reply)
        self._dead_man_switch = DeadManSwitch(
            # Not bound: a fault gives the client another session.
            lambda robot: self.peer.robot.stop(robot),
            call_later=self._loop.call_later,
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
        if self.peer.has_stalled_outbox() or (is_sending and sending_s > _MAX_SENDING_S):
            self._disconnect()

    def _close(self) -> None:
        self._dead_man_switch.close()
        self.peer.disconnect()
        if self._sending is not None:
            self._sending.cancel()
        # Not left to aiohttp, which would wait until all is read.
        self._connection.abort()

    def _disconnect(self) -> None:
        if not self._connection.is_closing:
            log.warning("page %s reads nothing: disconnected", self._connection.address)
            self._connection.abort()

    async def _receive(self) -> bool:
        """Handle one message; False at the end."""
        message = await self._websocket.receive()
        # Input of a connection that was ended is dropped: its replies would fill the outbox.
        if self._connection.is_closing:
            return False
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
        if isinstance(request, DriveRequest):
            self._dead_man_switch.record_drive(request)
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
            # The connection has ended, mostly, and its end is noticed by `_receive`.
            log.debug("page %s: not sent: %s", self._connection.address, error)
            self._connection.abort()


def _encode_reply(reply: Reply) -> bytes:
    return json_from_message(reply).encode()
