"""Server of the ZeroMQ stream (TCP 5005): requests, replies and frames on one ROUTER socket.

Clients pull: the reply to a frame request is the newest frame. So every client has its own pace,
nothing queues, and a client that stalls has no cost for any other.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from catoptra_protocol.errors import InvalidRequestError, RemoteProtocolError
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    Heartbeat,
    StartPosesReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    GetCameraRequest,
    GetLandmarksRequest,
    GetStartPosesRequest,
    GetStatusRequest,
    Request,
    SetAccuracyRequest,
)
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.simulation import SimulationEvent
from catoptra_server.transports.stream.frame_sender import FrameSender
from catoptra_server.transports.stream.landmark_replies import handle_landmarks_request
from catoptra_server.transports.stream.plan_replies import QueryPlan, handle_plan_request
from catoptra_server.transports.stream.router_socket import RouterSocket, SendResult
from catoptra_server.transports.stream.server_info import ServerInfo, transform_from_pose
from catoptra_server.transports.stream.stream_peer import StreamPeer

log = logging.getLogger(__name__)

# A client treats three missed heartbeats as a lost server; also the interval at which the server
# detects ended connections.
HEARTBEAT_INTERVAL_S = 0.5
# Encoded once: all clients get the same bytes.
_HEARTBEAT = bytes_from_message(Heartbeat(SCHEMA_VERSION))
# Heartbeats in a row to a client without a pending request. A busy program may not read: its unread
# heartbeats must not fill the queue of its ZeroMQ (64 messages in our client), or its connection
# stalls, and with it the answers to PING that keep its robot in the world.
MAX_IDLE_HEARTBEATS = 16
# Each client may have a robot.
MAX_PEERS = 256


class StreamServer:
    """All clients of the stream, from their first request to the end of their connection."""

    def __init__(
        self,
        host: str,
        port: int,
        *,
        mailboxes: Mailboxes,
        post: Callable[[SimulationEvent], None],
        server_info: ServerInfo,
        query_plan: QueryPlan,
    ) -> None:
        """Bind the port.

        Args:
            host: Host name or address of the interface.
            port: TCP port; 0 = a free one, see `port`.
            mailboxes: Newest frame of each channel.
            post: Hands an event to the simulation; thread-safe.
            server_info: Constant part of the replies.
            query_plan: Hands a camera to the render thread, for its plan.

        Raises:
            OSError: The port is not available.
        """
        self._mailboxes = mailboxes
        self._post = post
        self._server_info = server_info
        self._query_plan = query_plan
        self._peers: dict[bytes, StreamPeer] = {}
        self._possibly_disconnected: set[bytes] = set()
        self._socket = RouterSocket(host, port, self._handle_message)
        self.port = self._socket.port

    @property
    def peers(self) -> tuple[StreamPeer, ...]:
        """Connected clients, in the order of their first requests."""
        return tuple(self._peers.values())

    def close(self) -> None:
        """Disconnect all clients and close the socket."""
        self.disconnect_peers()
        self._socket.close()

    def disconnect_peers(self) -> None:
        """Disconnect all clients: their robots are removed."""
        # A copy: each disconnection removes its client from the dict.
        for identity in list(self._peers):
            self._disconnect(identity)

    def send_heartbeats(self) -> None:
        """Send due heartbeats, and remove clients whose connection has ended.

        Only a failed send identifies the client of an ended connection, and ZeroMQ may report the
        end a moment late: a possibly disconnected client gets one heartbeat now and one at the next
        call.
        """
        ended = self._socket.poll_disconnects()
        to_check = ended | self._possibly_disconnected
        for identity, peer in list(self._peers.items()):
            if peer.wants_heartbeat(MAX_IDLE_HEARTBEATS) or identity in to_check:
                self._send(identity, [_HEARTBEAT])
        self._possibly_disconnected = ended

    def _send(self, identity: bytes, parts: list[bytes]) -> SendResult:
        result = self._socket.send(identity, parts)
        if result is SendResult.DISCONNECTED:
            self._disconnect(identity)
        return result

    def _disconnect(self, identity: bytes) -> None:
        peer = self._peers.pop(identity, None)
        if peer is not None:
            peer.disconnect()
            num_sent = peer.frame_sender.num_sent
            log.info("stream client %s disconnected after %d frames", identity.hex(), num_sent)

    def _handle_message(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            request = _parse_request(parts)
        except RemoteProtocolError as error:
            log.debug("from stream client %s: %s", identity.hex(), error)
            id_ = error.request_id if isinstance(error, InvalidRequestError) else 0
            self._send(identity, [bytes_from_message(Error(id_, str(error)))])
            return
        log.debug("from stream client %s: %s", identity.hex(), request)
        # A client exists from its first valid request on; malformed messages add none.
        peer = self._peers.get(identity) or self._add_peer(identity)
        if peer is None:
            error_reply = Error(request.id, f"the limit of {MAX_PEERS} clients is reached")
            self._send(identity, [bytes_from_message(error_reply)])
            return
        # A client that sends a request has read its heartbeats.
        peer.reset_idle_count()
        self._handle_request(peer, request)

    def _add_peer(self, identity: bytes) -> StreamPeer | None:
        """New client; None at the limit."""
        if len(self._peers) >= MAX_PEERS:
            return None

        def send(parts: list[bytes]) -> SendResult:
            return self._send(identity, parts)

        frame_sender = FrameSender(send, self._mailboxes)
        peer = self._peers[identity] = StreamPeer(send, self._post, frame_sender)
        log.info("stream client %s connected", identity.hex())
        return peer

    def _handle_request(self, peer: StreamPeer, request: Request) -> None:
        """Serve requests about the server itself; all others belong to the client.

        A request without a case here or in StreamPeer fails the type check.
        """
        match request:
            case GetCameraRequest(id_, camera):
                peer.send_reply(self._camera_reply(id_, camera))
            case GetLandmarksRequest():
                landmarks = self._server_info.landmarks
                handle_landmarks_request(
                    request, landmarks, send_reply=peer.send_reply, post=self._post
                )
            case SetAccuracyRequest():
                handle_plan_request(
                    request,
                    peer,
                    send_reply=peer.send_reply,
                    post=self._post,
                    query_plan=self._query_plan,
                )
            case GetStartPosesRequest(id_):
                peer.send_reply(StartPosesReply(id_, self._server_info.start_poses))
            case GetStatusRequest(id_):
                peer.send_reply(self._status_reply(id_, peer))
            case _:
                peer.handle_request(request)

    def _camera_reply(self, id_: int, camera: str) -> CameraReply | Error:
        """Reply with the first camera of a name; an empty name selects the first of all."""
        # The first class with the camera: models are the same for all robots of a class.
        for (class_name, name), info in self._server_info.cameras.items():
            if camera in ("", name):
                model, mount = dict(info.camera_model), transform_from_pose(info.robot_from_mirror)
                return CameraReply(id_, class_name, name, model, mount, info.plan)
        known = ", ".join(name for _, name in self._server_info.cameras) or "none"
        return Error(id_, f"no camera {camera[:80]!r}: this server's robots have {known}")

    def _status_reply(self, id_: int, peer: StreamPeer) -> StatusReply:
        info = self._server_info
        return StatusReply(
            version=SCHEMA_VERSION,
            id=id_,
            server=info.server,
            world=info.world,
            class_names=info.class_names,
            clock=info.clock,
            num_clients=len(self._peers),
            has_robot=peer.has_robot,
            sent_frames=peer.frame_sender.num_sent,
        )


@asynccontextmanager
async def serve_stream(
    host: str,
    port: int,
    *,
    mailboxes: Mailboxes,
    post: Callable[[SimulationEvent], None],
    server_info: ServerInfo,
    query_plan: QueryPlan,
) -> AsyncIterator[StreamServer]:
    """Serve the stream until the block ends; for the arguments see StreamServer.

    Raises:
        OSError: The port is not available.
    """
    server = StreamServer(
        host, port, mailboxes=mailboxes, post=post, server_info=server_info, query_plan=query_plan
    )
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
        server.send_heartbeats()


def _parse_request(parts: list[bytes]) -> Request:
    # Rejected as a whole: a client that splits its request would lose the rest silently.
    if len(parts) != 1:
        raise RemoteProtocolError(f"a message of {len(parts)} parts: a request is one part")
    return request_from_bytes(parts[0])
