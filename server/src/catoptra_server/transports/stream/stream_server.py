"""The modern stream (ZeroMQ, TCP 5005): requests and answers, and frames, on one ROUTER socket.

Each client pulls: a frame is sent to whoever asked for one, the newest there is. So every client
has its own pace, nothing queues, and a client that stalls costs nobody anything.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from catoptra_protocol.errors import RemoteProtocolError
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
from catoptra_server.simulation import SimulationEvent as SimulationRequest
from catoptra_server.transports.stream.frame_sender import FrameSender
from catoptra_server.transports.stream.landmark_replies import handle_landmarks_request
from catoptra_server.transports.stream.plan_replies import QueryPlan, handle_plan_request
from catoptra_server.transports.stream.router_socket import RouterSocket, SendResult
from catoptra_server.transports.stream.server_info import ServerInfo, transform_from_pose
from catoptra_server.transports.stream.stream_peer import StreamPeer

log = logging.getLogger(__name__)

# How often every client is told that the server lives, and found out if it is gone.
HEARTBEAT_INTERVAL_S = 0.5
_HEARTBEAT = bytes_from_message(Heartbeat(SCHEMA_VERSION))
# Pulses in a row to a client that asks for nothing. It may be busy and not read: what it has not
# read must not fill what its ZeroMQ keeps (64 messages in our client's), or its connection stands
# still, and with it the answers to PING by which its robot stays.
MAX_IDLE_HEARTBEATS = 16
# Clients at once; each may hold a robot.
MAX_PEERS = 256


class StreamServer:
    """All clients of the stream, from their first request to the end of their connection."""

    def __init__(
        self,
        host: str,
        port: int,
        *,
        mailboxes: Mailboxes,
        post: Callable[[SimulationRequest], None],
        server_info: ServerInfo,
        query_plan: QueryPlan,
    ) -> None:
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
        """Return those who are served, in the order in which they came."""
        return tuple(self._peers.values())

    def close(self) -> None:
        """End all clients' business and the socket."""
        self.disconnect_peers()
        self._socket.close()

    def disconnect_peers(self) -> None:
        """End all clients' business."""
        for identity in list(self._peers):
            self._disconnect(identity)

    def send_heartbeats(self) -> None:
        """Tell clients that the server lives; forget those whose connection is gone.

        Only sending tells who is gone, and ZeroMQ may take note of it a moment late: who is
        suspected is sent one now and one at the next pulse.
        """
        suspects = self._socket.poll_disconnects()
        for identity, peer in list(self._peers.items()):
            if (
                peer.wants_heartbeat(MAX_IDLE_HEARTBEATS)
                or identity in suspects | self._possibly_disconnected
            ):
                self._send(identity, [_HEARTBEAT])
        self._possibly_disconnected = suspects

    def _send(self, identity: bytes, parts: list[bytes]) -> SendResult:
        sent = self._socket.send(identity, parts)
        if sent is SendResult.DISCONNECTED:
            self._disconnect(identity)
        return sent

    def _disconnect(self, identity: bytes) -> None:
        peer = self._peers.pop(identity, None)
        if peer is not None:
            peer.disconnect()
            log.info(
                "stream client %s gone after %d frames", identity.hex(), peer.frame_sender.num_sent
            )

    def _handle_message(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            request = _parse_request(parts)
        except RemoteProtocolError as error:
            log.debug("from stream client %s: %s", identity.hex(), error)
            self._send(identity, [bytes_from_message(Error(0, str(error)))])
            return
        log.debug("from stream client %s: %s", identity.hex(), request)
        peer = self._peers.get(identity) or self._add_peer(identity)
        if peer is None:
            refusal = Error(request.id, f"{MAX_PEERS} clients are served, no more")
            self._send(identity, [bytes_from_message(refusal)])
            return
        peer.reset_idle_count()
        self._handle_request(peer, request)

    def _add_peer(self, identity: bytes) -> StreamPeer | None:
        """Return a new client; None if there are enough."""
        if len(self._peers) >= MAX_PEERS:
            return None

        def send(parts: list[bytes]) -> SendResult:
            return self._send(identity, parts)

        slot = FrameSender(send, self._mailboxes)
        peer = self._peers[identity] = StreamPeer(send, self._post, slot)
        log.info("stream client %s came", identity.hex())
        return peer

    def _handle_request(self, peer: StreamPeer, request: Request) -> None:
        """Serve what concerns the whole server; leave the rest to the client."""
        match request:
            case GetCameraRequest(id_, name):
                peer.send_reply(self._camera_reply(id_, name))
            case GetLandmarksRequest():
                known = self._server_info.landmarks
                handle_landmarks_request(
                    request, known, send_reply=peer.send_reply, post=self._post
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

    def _camera_reply(self, id_: int, name: str) -> CameraReply | Error:
        """Return the first camera with a name, or the first of all."""
        for (class_name, name), facts in self._server_info.cameras.items():
            if name in ("", name):
                law, mount = dict(facts.camera_model), transform_from_pose(facts.robot_from_mirror)
                return CameraReply(id_, class_name, name, law, mount, facts.plan)
        known = ", ".join(name for _, name in self._server_info.cameras) or "none"
        return Error(id_, f"no camera {name[:80]!r}: this server's robots have {known}")

    def _status_reply(self, id_: int, peer: StreamPeer) -> StatusReply:
        facts = self._server_info
        return StatusReply(
            version=SCHEMA_VERSION,
            id=id_,
            server=facts.server,
            world=facts.world,
            class_names=facts.class_names,
            clock=facts.clock,
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
    post: Callable[[SimulationRequest], None],
    server_info: ServerInfo,
    query_plan: QueryPlan,
) -> AsyncIterator[StreamServer]:
    """Listen for clients of the stream until the block ends. Raises OSError without the port."""
    server = StreamServer(
        host, port, mailboxes=mailboxes, post=post, server_info=server_info, query_plan=query_plan
    )
    pulses = asyncio.create_task(_run_heartbeats(server))
    try:
        yield server
    finally:
        pulses.cancel()
        await asyncio.gather(pulses, return_exceptions=True)
        server.close()


async def _run_heartbeats(server: StreamServer) -> None:
    while True:
        await asyncio.sleep(HEARTBEAT_INTERVAL_S)
        server.send_heartbeats()


def _parse_request(parts: list[bytes]) -> Request:
    if len(parts) != 1:
        raise RemoteProtocolError(f"a message of {len(parts)} parts: a request is one part")
    return request_from_bytes(parts[0])
