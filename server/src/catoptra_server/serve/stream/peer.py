"""Clients of the stream: the requests of one, and the server of all on the ZeroMQ port (TCP 5005).

Clients pull: the reply to a frame request is the newest frame. So every client has a pace of its
own, nothing queues, and a client that stalls has no cost for any other. Each request has exactly
one reply with its id, unless the client disconnects before. A `StreamPeer` knows no socket: a page
of the web port is one, too.

**Heartbeats only for waiting clients.** A busy client that does not read must not find the
connection full of heartbeats: ZeroMQ would stop reading and answer no PING, which keeps the robot
in the world. A client that waits for nothing gets sixteen; ZeroMQ's monitor reports when the client
has disconnected.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Hashable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from typing import assert_never

from catoptra_protocol.errors import (
    CatoptraError,
    InvalidRequestError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.notes import check_note
from catoptra_protocol.stream.codec import FieldMap, fields_from_message, pack_fields
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.stream.replies import Error, Heartbeat, Ok, Reply, StartPosesReply
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPartsRequest,
    GetPixelRequest,
    GetReadingsRequest,
    GetSetupRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    PublishRequest,
    Request,
    ResetRequest,
    SetAccuracyRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_server.frames.frame import Payload
from catoptra_server.runtime.faults import log_fault
from catoptra_server.serve.limits import MAX_BLOCKED_S, MAX_PEERS, MAX_PENDING
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.stream.frames import FrameSender
from catoptra_server.serve.stream.replies import (
    StreamContext,
    camera_reply,
    landmarks_reply,
    parts_reply,
    request_pixel,
    request_plan,
    request_projections,
    request_state,
    setup_reply,
    status_reply,
)
from catoptra_server.serve.stream.router import Outbox, RouterSocket, SendResult
from catoptra_server.serve.stream.session import (
    INTERNAL_FAULT,
    PendingRequests,
    RobotSession,
)

log = logging.getLogger(__name__)
# A client treats three missed heartbeats as a lost server.
HEARTBEAT_INTERVAL_S = 0.5
# In a row, to a client without a pending request: a quarter of the queue of ZeroMQ, which has
# 64 messages in our client.
_MAX_IDLE_HEARTBEATS = 16
# Encoded once: all clients get the same bytes.
_HEARTBEAT = bytes_from_message(Heartbeat(SCHEMA_VERSION))
_NO_ROBOT = "this client has no robot: spawn one first (a lost connection removes its robot)"
# Messages that ZeroMQ had no room for are tried again: 400 a second cost less than a hundredth
# of the loop's time.
_FLUSH_INTERVAL_S = 0.02
_FLUSHED_PEERS = 8
_EncodeFields = Callable[[FieldMap], bytes]


class StreamPeer:
    """One client, from its first request to the end of the connection."""

    def __init__(
        self,
        outbox: Outbox,
        context: StreamContext,
        *,
        address: str,
        account: Hashable = None,
        encode: _EncodeFields,
    ) -> None:
        """Begin without a robot.

        Args:
            address: Host and port of the client, for logs.
            account: Pays for frames; None: this client alone.
            outbox: Messages to the client.
            context: What the clients of the server share.
            encode: Encodes the fields of a reply for the client's transport.
        """
        self._loop = asyncio.get_running_loop()
        self.address = address
        self.outbox = outbox
        self._context = context
        self._encode = encode
        self._pending = PendingRequests(self.send_reply)
        self.frame_sender = FrameSender(
            outbox,
            context.mailboxes,
            send_reply=self.send_reply,
            encode=encode,
            camera_names=context.server_info.camera_names,
            account=account,
        )
        self.robot = RobotSession(context.post, on_fault=self._replace_robot)
        context.clients.add(self)
        self._idle_heartbeats = 0
        self._blocked_since_s: float | None = None

    def disconnect(self) -> None:
        """Cancel pending work; the robot is removed from the world."""
        self._context.clients.discard(self)
        self.outbox.close()
        self._pending.cancel_all()
        self.frame_sender.end()
        self.robot.close()

    def send_reply(self, reply: Reply) -> None:
        """Send a reply, after all replies that wait for the client to read."""
        self.outbox.send(self._encode_reply(reply))

    def reset_idle_count(self) -> None:
        """Record a request: the client has read earlier messages."""
        self._idle_heartbeats = 0

    def wants_heartbeat(self, max_idle: int) -> bool:
        """Whether a heartbeat is due; counts those without a pending request, up to `max_idle`."""
        # Unread messages are a sign of life as good as a heartbeat.
        if self.outbox.is_blocked:
            return False
        # A client that waits reads, so heartbeats cannot accumulate.
        if len(self._pending) or self.frame_sender.has_pending_request:
            return True
        self._idle_heartbeats += 1
        return self._idle_heartbeats <= max_idle

    def has_stalled_outbox(self) -> bool:
        """Whether the client has read nothing for long; to be called regularly."""
        if self.outbox.flush() or not self.outbox.is_blocked:
            self._blocked_since_s = None
            return False
        now_s = self._loop.time()
        self._blocked_since_s = self._blocked_since_s or now_s
        return now_s - self._blocked_since_s > MAX_BLOCKED_S

    def serve(self, request: Request) -> None:
        """Reply to a request; a fault ends this request only."""
        try:
            self._require_room(request)
        except _RequestRefusedError as error:
            self.send_reply(Error(request.id, str(error)))
            return
        try:
            self._handle_request(request)
        except Exception:
            log_fault(log, "a stream request %s failed", request.KIND)
            self._pending.reject(request.id, INTERNAL_FAULT)

    def _require_room(self, request: Request) -> None:
        """Raise _RequestRefusedError where the client has sent too many requests for now."""
        # A request for a frame replaces the pending one.
        if isinstance(request, GetFrameRequest):
            return
        if len(self._pending) >= MAX_PENDING:
            raise _RequestRefusedError(
                f"{MAX_PENDING} requests are pending: wait for their replies"
            )
        if not self.robot.has_room:
            raise _RequestRefusedError(
                "the simulation has not executed the commands before: wait, and send it again"
            )

    def _handle_request(self, request: Request) -> None:
        """Serve a request; one without a case here fails the type check."""
        match request:
            case GetFrameRequest():
                self.frame_sender.submit(request)
            case SpawnRequest():
                self.robot.spawn(request, self._pending.add(request.id))
            case StepRequest(id_, time_s):
                self.robot.step(time_s, self._pending.add(id_))
            case ResetRequest(id_):
                self.robot.reset(self._pending.add(id_))
            # True positions never change, so neither robot nor simulation is needed.
            case GetLandmarksRequest(id_, None, None):
                self.send_reply(landmarks_reply(id_, self._context.server_info.landmarks))
            case GetLandmarksRequest(id_):
                request_projections(request, self._pending.add(id_), self.robot)
            case GetPixelRequest(id_):
                request_pixel(request, self._pending.add(id_), self.robot)
            case SetAccuracyRequest(id_):
                request_plan(request, self._pending.add(id_), self.robot, self._context.query_plan)
            case GetStateRequest(id_):
                pending = self._pending.add(id_)
                request_state(request, pending, self.robot, self._context.report_lines)
            case DriveRequest(id_) if request.robot:
                self.robot.drive_by_name(request, self._pending.add(id_))
            case (
                DriveRequest() | GetReadingsRequest() | PublishRequest() | ShareControlRequest()
            ) if not self.robot.has_robot:
                self.send_reply(Error(request.id, _NO_ROBOT))
            case DriveRequest(id_):
                self.robot.drive(request)
                self.send_reply(Ok(id_))
            case GetReadingsRequest(id_):
                self.send_reply(self.robot.readings_reply(id_))
            case PublishRequest():
                self._publish(request)
            case ShareControlRequest(id_, shared):
                self.robot.share_control(shared)
                self.send_reply(Ok(id_))
            case GetCameraRequest(id_, camera):
                info = self._context.server_info
                self.send_reply(camera_reply(id_, camera, info, self.robot))
            case GetPartsRequest(id_, class_name):
                self.send_reply(parts_reply(id_, class_name, self._context.server_info))
            case GetStartPosesRequest(id_):
                start_poses = self._context.server_info.start_poses
                self.send_reply(StartPosesReply(id_, start_poses))
            case GetSetupRequest(id_):
                self.send_reply(setup_reply(id_, self._context.server_info))
            case GetStatusRequest(id_):
                num_sent = self.frame_sender.num_sent
                self.send_reply(status_reply(id_, self._context, self.robot, num_sent=num_sent))
            case _:
                assert_never(request)

    def _publish(self, request: PublishRequest) -> None:
        # Checked here, where the JSON of one client delays no robot.
        try:
            check_note(request.name, request.text)
        except LocalProtocolError as error:
            self.send_reply(Error(request.id, str(error)))
        else:
            self.robot.publish(request, self._pending.add(request.id))

    def _replace_robot(self, reason: str) -> None:
        """Go on without a robot after a fault."""
        # Another object: late messages of the simulation about the old robot find a closed session.
        self.robot = RobotSession(self._context.post, on_fault=self._replace_robot)
        self._pending.reject_all(reason)

    def _encode_reply(self, reply: Reply) -> bytes:
        try:
            return self._encode(fields_from_message(reply.KIND, reply))
        except LocalProtocolError:
            # Contained here, since every reply passes here: the client is told in any case.
            log_fault(log, "a reply of kind %s was not sent", reply.KIND)
            error = Error(getattr(reply, "id", 0), INTERNAL_FAULT)
            return self._encode(fields_from_message(error.KIND, error))


class _RequestRefusedError(CatoptraError):
    """A client has to wait before another request."""


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
        # Peers with waiting messages, and the timer of their flush.
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
        # A copy: each disconnection removes a client from the dict.
        for identity in list(self._peers):
            self._remove_peer(identity)

    def send_heartbeats(self) -> None:
        """Send due heartbeats, and remove clients that read nothing."""
        for identity, peer in list(self._peers.items()):
            if peer.has_stalled_outbox():
                self._end_connection(identity, peer)
            elif peer.wants_heartbeat(_MAX_IDLE_HEARTBEATS):
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
            log.info("stream client %s disconnected after %d frames", peer.address, num_sent)

    def _end_connection(self, identity: bytes, peer: StreamPeer) -> None:
        """Disconnect a client that reads too few of the replies."""
        if self._peers.get(identity) is peer:
            log.warning("stream client %s reads nothing: disconnected", peer.address)
            self._remove_peer(identity)
            self._socket.disconnect(identity)

    def _handle_message(self, identity: bytes, parts: list[bytes]) -> None:
        connection = self._socket.find_connection(identity)
        begin_s = time.thread_time()
        try:
            self._receive(identity, parts)
        except Exception:
            log_fault(log, "a stream message failed")
            self._reject(identity, Error(0, INTERNAL_FAULT))
        if connection is not None:
            duration_s = time.thread_time() - begin_s
            connection.account.charge(duration_s, is_dialogue=connection.is_dialogue)

    def _receive(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            request = _parse_request(parts)
        except RemoteProtocolError as error:
            log.debug("from stream client %s: %s", identity.hex(), error)
            id_ = error.request_id if isinstance(error, InvalidRequestError) else 0
            self._reject(identity, Error(id_, str(error)))
            return
        log.debug("from stream client %s: %s", identity.hex(), request)
        # A client exists from the first valid request on; malformed messages add none.
        peer = self._peers.get(identity) or self._add_peer(identity)
        if peer is None:
            limit = f"the limit of {MAX_PEERS} clients is reached"
            self._reject(identity, Error(request.id, limit))
            return
        # A client that sends a request has read all heartbeats.
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
        connection = self._socket.find_connection(identity)
        address = connection.address if connection else identity.hex()
        peer = self._peers[identity] = StreamPeer(
            outbox,
            self._context,
            address=address,
            account=connection.account if connection else None,
            encode=pack_fields,
        )
        if connection is not None:
            connection.has_robot = lambda: peer.robot.has_robot
        log.info("stream client %s connected", address)
        return peer

    def _schedule_flush(self, peer: StreamPeer | None = None) -> None:
        """Send waiting messages soon, also of a newly blocked peer."""
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
    # Rejected as a whole: a client that splits a request would lose the rest silently.
    if len(parts) != 1:
        raise RemoteProtocolError(f"a message of {len(parts)} parts: a request is one part")
    return request_from_bytes(parts[0])
