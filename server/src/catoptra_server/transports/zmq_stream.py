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
from catoptra_protocol.wire.stream import (
    SCHEMA_VERSION,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.wire.stream_answers import (
    CameraIs,
    Pulse,
    Refused,
    StartsAre,
    StatusIs,
)
from catoptra_protocol.wire.stream_requests import (
    AskCamera,
    AskLandmarks,
    AskPlan,
    AskStarts,
    AskStatus,
    Request,
)
from catoptra_server.mailbox import Mailboxes
from catoptra_server.simulation import Request as SimulationRequest
from catoptra_server.transports.zmq_stream_facts import StreamFacts, placement
from catoptra_server.transports.zmq_stream_frames import FrameSlot
from catoptra_server.transports.zmq_stream_landmarks import answer_landmarks
from catoptra_server.transports.zmq_stream_peer import StreamPeer
from catoptra_server.transports.zmq_stream_plans import PlanOf, answer_plan
from catoptra_server.transports.zmq_stream_socket import RouterSocket, Sent

log = logging.getLogger(__name__)

# How often every client is told that the server lives, and found out if it is gone.
PULSE_S = 0.5
_PULSE = bytes_from_message(Pulse(SCHEMA_VERSION))
# Pulses in a row to a client that asks for nothing. It may be busy and not read: what it has not
# read must not fill what its ZeroMQ keeps (64 messages in our client's), or its connection stands
# still, and with it the answers to PING by which its robot stays.
IDLE_PULSES = 16
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
        facts: StreamFacts,
        plan_of: PlanOf,
    ) -> None:
        self._mailboxes = mailboxes
        self._post = post
        self._facts = facts
        self._plan_of = plan_of
        self._peers: dict[bytes, StreamPeer] = {}
        self._suspects: set[bytes] = set()
        self._socket = RouterSocket(host, port, self._received)
        self.port = self._socket.port

    @property
    def peers(self) -> tuple[StreamPeer, ...]:
        """Return those who are served, in the order in which they came."""
        return tuple(self._peers.values())

    def close(self) -> None:
        """End all clients' business and the socket."""
        self.close_peers()
        self._socket.close()

    def close_peers(self) -> None:
        """End all clients' business."""
        for identity in list(self._peers):
            self._leave(identity)

    def pulse(self) -> None:
        """Tell clients that the server lives; forget those whose connection is gone.

        Only sending tells who is gone, and ZeroMQ may take note of it a moment late: who is
        suspected is sent one now and one at the next pulse.
        """
        suspects = self._socket.suspects()
        for identity, peer in list(self._peers.items()):
            if peer.takes_pulse(IDLE_PULSES) or identity in suspects | self._suspects:
                self._send(identity, [_PULSE])
        self._suspects = suspects

    def _send(self, identity: bytes, parts: list[bytes]) -> Sent:
        sent = self._socket.send(identity, parts)
        if sent is Sent.PEER_IS_GONE:
            self._leave(identity)
        return sent

    def _leave(self, identity: bytes) -> None:
        peer = self._peers.pop(identity, None)
        if peer is not None:
            peer.leave()
            log.info("stream client %s gone after %d frames", identity.hex(), peer.slot.sent)

    def _received(self, identity: bytes, parts: list[bytes]) -> None:
        try:
            request = _request(parts)
        except RemoteProtocolError as error:
            log.debug("from stream client %s: %s", identity.hex(), error)
            self._send(identity, [bytes_from_message(Refused(0, str(error)))])
            return
        log.debug("from stream client %s: %s", identity.hex(), request)
        peer = self._peers.get(identity) or self._welcome(identity)
        if peer is None:
            refusal = Refused(request.id, f"{MAX_PEERS} clients are served, no more")
            self._send(identity, [bytes_from_message(refusal)])
            return
        peer.heard()
        self._serve(peer, request)

    def _welcome(self, identity: bytes) -> StreamPeer | None:
        """Return a new client; None if there are enough."""
        if len(self._peers) >= MAX_PEERS:
            return None

        def send(parts: list[bytes]) -> Sent:
            return self._send(identity, parts)

        slot = FrameSlot(send, self._mailboxes)
        peer = self._peers[identity] = StreamPeer(send, self._post, slot)
        log.info("stream client %s came", identity.hex())
        return peer

    def _serve(self, peer: StreamPeer, request: Request) -> None:
        """Serve what concerns the whole server; leave the rest to the client."""
        match request:
            case AskCamera(id_, name):
                peer.answer(self._camera(id_, name))
            case AskLandmarks():
                known = self._facts.landmarks
                answer_landmarks(request, known, answer=peer.answer, post=self._post)
            case AskPlan():
                answer_plan(
                    request, peer, answer=peer.answer, post=self._post, plan_of=self._plan_of
                )
            case AskStarts(id_):
                peer.answer(StartsAre(id_, self._facts.starts))
            case AskStatus(id_):
                peer.answer(self._status(id_, peer))
            case _:
                peer.serve(request)

    def _camera(self, id_: int, wished: str) -> CameraIs | Refused:
        """Return the first camera with a name, or the first of all."""
        for (class_name, name), facts in self._facts.cameras.items():
            if wished in ("", name):
                law, mount = dict(facts.law), placement(facts.robot_from_mirror)
                return CameraIs(id_, class_name, name, law, mount, facts.plan)
        known = ", ".join(name for _, name in self._facts.cameras) or "none"
        return Refused(id_, f"no camera {wished[:80]!r}: this server's robots have {known}")

    def _status(self, id_: int, peer: StreamPeer) -> StatusIs:
        facts = self._facts
        return StatusIs(
            version=SCHEMA_VERSION,
            id=id_,
            server=facts.server,
            world=facts.world,
            class_names=facts.class_names,
            clock=facts.clock,
            clients=len(self._peers),
            has_robot=peer.has_robot,
            sent=peer.slot.sent,
        )


@asynccontextmanager
async def serve_stream(
    host: str,
    port: int,
    *,
    mailboxes: Mailboxes,
    post: Callable[[SimulationRequest], None],
    facts: StreamFacts,
    plan_of: PlanOf,
) -> AsyncIterator[StreamServer]:
    """Listen for clients of the stream until the block ends. Raises OSError without the port."""
    server = StreamServer(host, port, mailboxes=mailboxes, post=post, facts=facts, plan_of=plan_of)
    pulses = asyncio.create_task(_pulses(server))
    try:
        yield server
    finally:
        pulses.cancel()
        await asyncio.gather(pulses, return_exceptions=True)
        server.close()


async def _pulses(server: StreamServer) -> None:
    while True:
        await asyncio.sleep(PULSE_S)
        server.pulse()


def _request(parts: list[bytes]) -> Request:
    if len(parts) != 1:
        raise RemoteProtocolError(f"a message of {len(parts)} parts: a request is one part")
    return request_from_bytes(parts[0])
