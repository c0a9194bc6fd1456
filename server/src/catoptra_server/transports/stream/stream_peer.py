"""One client of the stream: its requests, its robot, its frames.

Each request has exactly one reply with its id, unless the client disconnects before.
"""

from __future__ import annotations

import asyncio
import logging
from typing import assert_never

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Ok, Reply
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetReadingsRequest,
    Request,
    ResetRequest,
    SetAccuracyRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_server.fault_log import log_fault
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.transports.stream.frame_sender import FrameSender
from catoptra_server.transports.stream.landmark_replies import request_projections
from catoptra_server.transports.stream.outbox import Outbox
from catoptra_server.transports.stream.pending_requests import (
    INTERNAL_FAULT,
    MAX_PENDING,
    PendingRequests,
)
from catoptra_server.transports.stream.plan_replies import QueryPlan, request_plan
from catoptra_server.transports.stream.robot_session import Post, RobotSession

log = logging.getLogger(__name__)

_NO_ROBOT = "this client has no robot: spawn one first (a lost connection removes its robot)"
# A client that reads nothing for so long is not a busy program: ZeroMQ reads for that one, until
# its queue is full. Linux ends the connection itself then (TCP_USER_TIMEOUT of the guard).
_MAX_BLOCKED_S = 6.0

# Requests of a single client; StreamServer serves the others.
PeerRequest = (
    GetFrameRequest
    | SpawnRequest
    | StepRequest
    | ResetRequest
    | DriveRequest
    | GetReadingsRequest
    | GetLandmarksRequest
    | SetAccuracyRequest
)


class StreamPeer:
    """One client, from its first request to the end of its connection."""

    def __init__(
        self, outbox: Outbox, *, mailboxes: Mailboxes, post: Post, query_plan: QueryPlan
    ) -> None:
        """Begin without a robot.

        Args:
            outbox: Messages to the client.
            mailboxes: Newest frame of each channel.
            post: Hands an event to the simulation.
            query_plan: Hands a camera to the render thread, for its plan.
        """
        self._loop = asyncio.get_running_loop()
        self.outbox = outbox
        self._post = post
        self._query_plan = query_plan
        self._pending = PendingRequests(self.send_reply)
        self.frame_sender = FrameSender(outbox, mailboxes, send_reply=self.send_reply)
        self.robot = RobotSession(post, on_fault=self._replace_robot)
        self._idle_heartbeats = 0
        self._blocked_since_s: float | None = None

    def disconnect(self) -> None:
        """Cancel pending work; the robot is removed from the world."""
        self.outbox.close()
        self._pending.cancel_all()
        self.frame_sender.close()
        self.robot.close()

    def send_reply(self, reply: Reply) -> None:
        """Send a reply, after all replies that wait for the client to read."""
        self.outbox.send(_encode_reply(reply))

    def reset_idle_count(self) -> None:
        """Record a request: the client has read its earlier messages."""
        self._idle_heartbeats = 0

    def wants_heartbeat(self, max_idle: int) -> bool:
        """Whether a heartbeat is due; counts those without a pending request, up to `max_idle`."""
        # Unread messages are a sign of life as good as a heartbeat.
        if self.outbox.is_blocked:
            return False
        # A client that waits reads, so its heartbeats cannot accumulate.
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
        return now_s - self._blocked_since_s > _MAX_BLOCKED_S

    def find_refusal(self, request: Request) -> str:
        """Reason against any further request now; empty if there is none."""
        # A request for a frame replaces the pending one.
        if isinstance(request, GetFrameRequest):
            return ""
        if len(self._pending) >= MAX_PENDING:
            return f"{MAX_PENDING} requests are pending: wait for their replies"
        if not self.robot.has_room:
            return "the simulation has not executed the commands before: wait, and send it again"
        return ""

    def handle_request(self, request: PeerRequest) -> None:
        """Serve a request about the client's own robot and frames."""
        match request:
            case GetFrameRequest():
                self.frame_sender.submit(request)
            case SpawnRequest():
                self._spawn(request)
            case StepRequest(id_, time_s):
                self.robot.step(time_s, self._pending.add(id_))
            case ResetRequest(id_):
                self.robot.reset(self._pending.add(id_))
            case GetLandmarksRequest(id_):
                request_projections(request, self._pending.add(id_), self.robot)
            case SetAccuracyRequest(id_):
                request_plan(request, self._pending.add(id_), self.robot, self._query_plan)
            case DriveRequest() | GetReadingsRequest() if not self.robot.has_robot:
                self.send_reply(Error(request.id, _NO_ROBOT))
            case DriveRequest(id_):
                self.robot.drive(request)
                self.send_reply(Ok(id_))
            case GetReadingsRequest(id_):
                self.send_reply(self.robot.readings_reply(id_))
            case _:
                assert_never(request)

    def reject_request(self, request: Request, reason: str) -> None:
        """Send an error to a request that was handed to this client."""
        self._pending.reject(request.id, reason)

    def _spawn(self, request: SpawnRequest) -> None:
        # Reasons known here go to the client at once.
        reason = self.robot.find_spawn_error(request)
        if reason:
            self.send_reply(Error(request.id, reason))
        else:
            self.robot.spawn(request, self._pending.add(request.id))

    def _replace_robot(self, reason: str) -> None:
        """Go on without a robot after a fault."""
        # Another object: late messages of the simulation about the old robot find it closed.
        self.robot = RobotSession(self._post, on_fault=self._replace_robot)
        self._pending.reject_all(reason)


def _encode_reply(reply: Reply) -> bytes:
    try:
        return bytes_from_message(reply)
    except LocalProtocolError:
        # Contained here, since every reply passes here: the client is told in any case.
        log_fault(log, "a reply of kind %s was not sent", reply.KIND)
        return bytes_from_message(Error(getattr(reply, "id", 0), INTERNAL_FAULT))
