"""Server of the ZeroMQ stream (TCP 5005): requests, replies and frames on one ROUTER socket.

Clients pull: the reply to a frame request is the newest frame. So every client has its own pace,
nothing queues, and a client that stalls has no cost for any other.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import partial

from catoptra_protocol.errors import InvalidRequestError, RemoteProtocolError
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.stream.replies import Error, Heartbeat
from catoptra_protocol.stream.requests import Request
from catoptra_server.frames.encode import Payload
from catoptra_server.runtime.faults import log_fault
from catoptra_server.transports.stream.outbox import Outbox, SendResult
from catoptra_server.transports.stream.pending_requests import INTERNAL_FAULT
from catoptra_server.transports.stream.router_socket import RouterSocket
from catoptra_server.transports.stream.stream_context import StreamContext
from catoptra_server.transports.stream.stream_peer import StreamPeer
from catoptra_server.transports.tcp_server import ConnectionLimits

log = logging.getLogger(__name__)

# A client treats three missed heartbeats as a lost server.
HEARTBEAT_INTERVAL_S = 0.5
# Encoded once: all clients get the same bytes.
_HEARTBEAT = bytes_from_message(Heartbeat(SCHEMA_VERSION))
# Heartbeats in a row to a client without a pending request. A busy program may not read: its unread
# heartbeats must not fill the queue of its ZeroMQ (64 messages in our client), or its connection
# stalls, and with it the answers to PING that keep its robot in the world.
MAX_IDLE_HEARTBEATS = 16
# Each client may have a robot.
MAX_PEERS = 256
# Messages that ZeroMQ had no room for are tried again: 400 of them a second cost the loop less than
# a hundredth of its time.
_FLUSH_INTERVAL_S = 0.02
_FLUSHED_PEERS = 8


class StreamServer:
    """All clients of the stream, from their first request to the end of their connection."""

    def __init__(
        self, listener: socket.socket, context: StreamContext, *, limits: ConnectionLimits
    ) -> None:
        """Accept clients.

        Args:
            listener: Listening socket of the port; closed with this server.
            context: What the clients of the server share.
            limits: Limits of the connections.

        Raises:
            OSError: The private socket of the ROUTER is not available.
        """
        self._loop = asyncio.get_running_loop()
        self._context = context
        self._peers: dict[bytes, StreamPeer] = {}
        # Peers with waiting messages, and the timer that sends them.
        self._blocked: deque[StreamPeer] = deque()
        self._flush_timer: asyncio.TimerHandle | None = None
        self._socket = RouterSocket(
            listener,
            limits=limits,
            on_message=self._handle_message,
            on_disconnect=self._remove_peer,
        )
        self.port = self._socket.port

    @property
    def peers(self) -> tuple[StreamPeer, ...]:
        """Connected clients, in the order of their first requests."""
        return tuple(self._peers.values())

    def close(self) -> None:
        """Disconnect all clients and close the socket."""
        self.disconnect_peers()
        if self._flush_timer is not None:
            self._flush_timer.cancel()
        self._socket.close()

    def disconnect_peers(self) -> None:
        """Disconnect all clients: their robots are removed."""
        # A copy: each disconnection removes its client from the dict.
        for identity in list(self._peers):
            self._remove_peer(identity)

    def send_heartbeats(self) -> None:
        """Send due heartbeats, and remove clients that read nothing."""
        for identity, peer in list(self._peers.items()):
            if peer.has_stalled_outbox():
                self._end_connection(identity, peer)
            elif peer.wants_heartbeat(MAX_IDLE_HEARTBEATS):
                self._send(identity, [_HEARTBEAT])

    def _send(self, identity: bytes, parts: Sequence[Payload]) -> SendResult:
        result = self._socket.send(identity, parts)
        if result is SendResult.DISCONNECTED:
            self._remove_peer(identity)
        return result

    def _remove_peer(self, identity: bytes) -> None:
        peer = self._peers.pop(identity, None)
        if peer is not None:
            peer.disconnect()
            num_sent = peer.frame_sender.num_sent
            log.info("stream client %s disconnected after %d frames", identity.hex(), num_sent)

    def _end_connection(self, identity: bytes, peer: StreamPeer) -> None:
        """Disconnect a client that reads too little for its replies."""
        if self._peers.get(identity) is peer:
            log.warning("stream client %s reads nothing: disconnected", identity.hex())
            self._remove_peer(identity)
            self._socket.disconnect(identity)

    def _handle_message(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            self._receive(identity, parts)
        except Exception:
            log_fault(log, "a stream message failed")
            self._reject(identity, Error(0, INTERNAL_FAULT))

    def _receive(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            request = _parse_request(parts)
        except RemoteProtocolError as error:
            log.debug("from stream client %s: %s", identity.hex(), error)
            id_ = error.request_id if isinstance(error, InvalidRequestError) else 0
            self._reject(identity, Error(id_, str(error)))
            return
        log.debug("from stream client %s: %s", identity.hex(), request)
        # A client exists from its first valid request on; malformed messages add none.
        peer = self._peers.get(identity) or self._add_peer(identity)
        if peer is None:
            limit = f"the limit of {MAX_PEERS} clients is reached"
            self._reject(identity, Error(request.id, limit))
            return
        # A client that sends a request has read its heartbeats.
        peer.reset_idle_count()
        peer.serve(request)

    def _reject(self, identity: bytes, error: Error) -> None:
        """Send an error about a message, whether or not its sender is a client."""
        peer = self._peers.get(identity)
        if peer is not None:
            peer.send_reply(error)
        # A sender of malformed messages only, which does not read, has no queue.
        elif self._send(identity, [bytes_from_message(error)]) is SendResult.QUEUE_FULL:
            self._socket.disconnect(identity)

    def _add_peer(self, identity: bytes) -> StreamPeer | None:
        """New client; None at the limit."""
        if len(self._peers) >= MAX_PEERS:
            return None
        outbox = Outbox(
            partial(self._send, identity),
            on_blocked=lambda: self._schedule_flush(peer),
            # Later: the caller has more to do with the peer.
            on_overflow=lambda: self._loop.call_soon(self._end_connection, identity, peer),
        )
        peer = self._peers[identity] = StreamPeer(outbox, self._context, encode=bytes_from_message)
        log.info("stream client %s connected", identity.hex())
        return peer

    def _schedule_flush(self, peer: StreamPeer | None = None) -> None:
        """Send waiting messages soon, those of a newly blocked peer among them."""
        if peer is not None:
            self._blocked.append(peer)
        if self._blocked and self._flush_timer is None:
            self._flush_timer = self._loop.call_later(_FLUSH_INTERVAL_S, self._flush_outboxes)

    def _flush_outboxes(self) -> None:
        self._flush_timer = None
        # A few in turn, so that peers that read nothing cost no time, however many.
        for _ in range(min(_FLUSHED_PEERS, len(self._blocked))):
            peer = self._blocked.popleft()
            peer.outbox.flush()
            if peer.outbox.is_blocked:
                self._blocked.append(peer)
        self._schedule_flush()


@asynccontextmanager
async def serve_stream(
    listener: socket.socket, context: StreamContext, *, limits: ConnectionLimits
) -> AsyncIterator[StreamServer]:
    """Serve the stream until the block ends; for the arguments see StreamServer.

    Raises:
        OSError: The private socket of the ROUTER is not available.
    """
    server = StreamServer(listener, context, limits=limits)
    heartbeats = asyncio.create_task(_run_heartbeats(server))
    try:
        yield server
    finally:
        # Before the socket closes: a heartbeat must not be sent to a closed one.
        heartbeats.cancel()
        await asyncio.gather(heartbeats, return_exceptions=True)
        server.close()


async def _run_heartbeats(server: StreamServer) -> None:
    while True:
        await asyncio.sleep(HEARTBEAT_INTERVAL_S)
        try:
            server.send_heartbeats()
        # Without heartbeats all clients would take the server for lost.
        except Exception:
            log_fault(log, "heartbeats failed")


def _parse_request(parts: list[bytes]) -> Request:
    # Rejected as a whole: a client that splits its request would lose the rest silently.
    if len(parts) != 1:
        raise RemoteProtocolError(f"a message of {len(parts)} parts: a request is one part")
    return request_from_bytes(parts[0])
