"""Requests to a stream server, one at a time, each with its reply or an error."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.errors import CatoptraError, DeadlineExceededError, RemoteProtocolError
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import Error, FrameHeader, Reply
from catoptra_protocol.stream.requests import GetFrameRequest, Request

_LOG = logging.getLogger(__name__)
# A restarted server has lost the request. Repeating one with the same id is safe (SPEC.md 9.4).
_RETRY_INTERVAL_S = 1.0

_ReplyT = TypeVar("_ReplyT", bound=Reply)
Parts = list[bytes]


class RequestExchange:
    """Exchange of requests and replies over a socket, which closing ends."""

    def __init__(
        self, socket: StreamSocket, *, timeout_s: float, clock: Callable[[], float]
    ) -> None:
        """Exchange by a socket.

        Args:
            socket: Connection to the server, closed with the exchange.
            timeout_s: Timeout of each request.
            clock: Clock of the timeouts, in seconds.
        """
        self._socket = socket
        self._timeout_s = timeout_s
        self._clock = clock

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def call(self, request: Request, reply_type: type[_ReplyT]) -> _ReplyT:
        """Reply of a type to a request.

        Raises:
            ConnectionLostError: The server sends nothing for 1.5 s.
            DeadlineExceededError: The server sends heartbeats but no reply in time.
            CatoptraError: The request is rejected; the text is the server's reason.
            RemoteProtocolError: The reply is of another type, or the request is unreadable.
        """
        return self._exchange(request, reply_type, f"a reply to {request.KIND}")[0]

    def request_frame(self, request: GetFrameRequest) -> tuple[FrameHeader, Parts]:
        """Header and image of a frame; errors as of `call`."""
        return self._exchange(request, FrameHeader, "a frame", retry_interval_s=_RETRY_INTERVAL_S)

    def _exchange(
        self,
        request: Request,
        reply_type: type[_ReplyT],
        description: str,
        retry_interval_s: float | None = None,
    ) -> tuple[_ReplyT, Parts]:
        """Send a request; its reply and the parts after the reply."""
        data = bytes_from_message(request)
        deadline_s = self._clock() + self._timeout_s
        self._socket.begin_wait()
        while True:
            _LOG.debug("to %s: %s", self._socket.address, request)
            # Repeated for frames only: a repeated drive or step would be executed twice.
            self._socket.send(data, deadline_s)
            until_s = deadline_s if retry_interval_s is None else self._clock() + retry_interval_s
            received = self._wait_for_reply(request.id, min(until_s, deadline_s))
            if received is not None:
                return self._check_reply(received[0], reply_type), received[1]
            if self._clock() >= deadline_s:
                # Heartbeats distinguish a lost server from a slow one: the remedies differ.
                self._socket.check_alive()
                raise DeadlineExceededError(
                    f"{self._socket.address} sends heartbeats but not {description} within "
                    f"{self._timeout_s:g} s: it is busy rendering or stepping; wait, or use a "
                    "larger timeout_s"
                )

    def _wait_for_reply(self, id_: int, deadline_s: float) -> tuple[Reply, Parts] | None:
        """Reply with an id; heartbeats and late replies of earlier requests are skipped."""
        while (parts := self._socket.receive(deadline_s)) is not None:
            reply = reply_from_bytes(parts[0])
            _LOG.debug("from %s: %s", self._socket.address, reply)
            # Raised for any request: the id of an unreadable one is unknown to the server.
            if isinstance(reply, Error) and reply.id == 0:
                raise RemoteProtocolError(
                    f"{self._socket.address} cannot read the request: {reply.reason}"
                )
            # A late reply of a call that timed out has a lower id, a heartbeat none.
            if reply is not None and getattr(reply, "id", None) == id_:
                return reply, parts[1:]
        return None

    def _check_reply(self, reply: Reply, reply_type: type[_ReplyT]) -> _ReplyT:
        if isinstance(reply, Error):
            raise CatoptraError(f"{self._socket.address} rejected the request: {reply.reason}")
        if not isinstance(reply, reply_type):
            raise RemoteProtocolError(f"{self._socket.address} replied with {reply.KIND}")
        return reply
