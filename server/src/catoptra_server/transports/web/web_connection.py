"""One accepted connection of the web port: aiohttp's protocol, held back when it sends too much."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from aiohttp import web

from catoptra_server.runtime.faults import log_fault
from catoptra_server.transports.loop_share import LoopAccount
from catoptra_server.transports.stream.pending_requests import INTERNAL_FAULT
from catoptra_server.transports.web.web_responses import text_response

log = logging.getLogger(__name__)

# Time of the loop for a read beside the parser's, and for a request with its reply.
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
            tcp_keepalive=False,  # AcceptLoop has set it
            access_log=None,  # type: ignore[arg-type] # None is no log
            logger=log,
            max_line_size=_MAX_LINE_BYTES,
            max_field_size=_MAX_FIELD_BYTES,
            max_headers=_MAX_FIELDS,
            lingering_time=0.0,  # no request has a body that would be read to its end
        )
        self.address = address
        self.opened_at_s = opened_at_s
        self.is_websocket = False
        """Whether the connection has become a WebSocket, which may live long."""
        self._account = account
        self._on_lost = on_lost
        self._open_loop = loop
        self._hold: asyncio.TimerHandle | None = None
        self._num_request_bytes = 0
        self._num_messages = 0
        self._num_unanswered = 0

    def data_received(self, data: bytes) -> None:
        """Parse input, and read no more for a while once too much of the loop was used."""
        if self._is_dialogue:
            # A peer that waits for replies occupies the loop with few requests at any time.
            self._account.write_off()
        self._num_messages = 0
        self._num_request_bytes += len(data)
        if not self.is_websocket and self._num_request_bytes > _MAX_REQUEST_BYTES:
            log.info("web connection of %s closed: its request has no end", self.address)
            self.abort()
            return
        self._account.charge(_READ_COST_S)
        with self._account.charge_block():
            super().data_received(data)
        self._hold_back()

    async def begin_request(self) -> None:
        """Charge a request or a message, and wait until the connection may use the loop again."""
        self._num_messages += 1
        self._num_unanswered += 1
        self._num_request_bytes = 0
        self._account.charge(_REQUEST_COST_S)
        # With eight pages the price of one request, 36 ms of waiting, is above the burst already.
        if not self._is_dialogue:
            self._hold_back()
            await self._account.wait()

    def note_reply(self) -> None:
        """Record that something was sent."""
        self._num_unanswered = max(self._num_unanswered - 1, 0)

    @property
    def _is_dialogue(self) -> bool:
        """Whether the peer waits for replies; one may be sent that is not noted yet."""
        return self._num_unanswered <= _MAX_DIALOGUE + 1 and self._num_messages <= _MAX_DIALOGUE

    @property
    def is_closing(self) -> bool:
        """Whether nothing more is sent."""
        return self.transport is None or self.transport.is_closing()

    def abort(self) -> None:
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
            # The peer's fault: no traceback, which it could cause at will.
            reason = "not a valid HTTP request"
            log.info("web connection of %s closed: %s", self.address, reason)
        response = text_response(status, reason)
        response.force_close()
        return response

    def _hold_back(self) -> None:
        wait_s = self._account.remaining_wait_s
        if wait_s > 0.0 and self._hold is None and self.transport is not None:
            self.transport.pause_reading()
            self._hold = self._open_loop.call_later(wait_s, self._release)

    def _release(self) -> None:
        self._hold = None
        if not (self._reading_paused or self._buffer_paused):
            self._resume_transport_reading()

    def _resume_transport_reading(self) -> None:
        # By aiohttp, when it has room again; the hold goes on all the same.
        if self._hold is None:
            super()._resume_transport_reading()

    def connection_lost(self, exc: BaseException | None) -> None:
        """Record the end; called by asyncio."""
        if self._hold is not None:
            self._hold.cancel()
        self._on_lost(self)
        super().connection_lost(exc)
