"""One client of the stream: its requests, its robot, its frames.

Each request has exactly one reply with its id, unless the client disconnects before.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import assert_never

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.notes import find_note_error
from catoptra_protocol.stream.replies import Error, Ok, Reply, StartPosesReply
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPixelRequest,
    GetReadingsRequest,
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
from catoptra_server.runtime.faults import log_fault
from catoptra_server.transports.stream.frame_sender import FrameSender
from catoptra_server.transports.stream.landmark_replies import (
    landmarks_reply,
    request_projections,
)
from catoptra_server.transports.stream.outbox import Outbox
from catoptra_server.transports.stream.pending_requests import (
    INTERNAL_FAULT,
    MAX_PENDING,
    PendingRequests,
)
from catoptra_server.transports.stream.pixel_replies import request_pixel
from catoptra_server.transports.stream.plan_replies import request_plan
from catoptra_server.transports.stream.robot_session import RobotSession
from catoptra_server.transports.stream.server_replies import camera_reply, status_reply
from catoptra_server.transports.stream.state_replies import request_state
from catoptra_server.transports.stream.stream_context import StreamContext

log = logging.getLogger(__name__)

_NO_ROBOT = "this client has no robot: spawn one first (a lost connection removes its robot)"
# A client that reads nothing for so long is not a busy program: ZeroMQ reads for that one, until
# its queue is full. Linux ends the connection itself then (TCP_USER_TIMEOUT of the guard).
_MAX_BLOCKED_S = 6.0

EncodeReply = Callable[[Reply], bytes]


class StreamPeer:
    """One client, from its first request to the end of its connection."""

    def __init__(self, outbox: Outbox, context: StreamContext, *, encode: EncodeReply) -> None:
        """Begin without a robot.

        Args:
            outbox: Messages to the client.
            context: What the clients of the server share.
            encode: Encodes a reply for the client's transport.
        """
        self._loop = asyncio.get_running_loop()
        self.outbox = outbox
        self._context = context
        self._encode = encode
        self._pending = PendingRequests(self.send_reply)
        self.frame_sender = FrameSender(
            outbox, context.mailboxes, send_reply=self.send_reply, encode=encode
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
        self.frame_sender.close()
        self.robot.close()

    def send_reply(self, reply: Reply) -> None:
        """Send a reply, after all replies that wait for the client to read."""
        self.outbox.send(self._encode_reply(reply))

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

    def serve(self, request: Request) -> None:
        """Reply to a request; a fault in its handling ends this request only."""
        refusal = self._find_refusal(request)
        if refusal:
            self.send_reply(Error(request.id, refusal))
            return
        try:
            self._handle_request(request)
        except Exception:
            log_fault(log, "a stream request %s failed", request.KIND)
            self._pending.reject(request.id, INTERNAL_FAULT)

    def _find_refusal(self, request: Request) -> str:
        """Reason against any further request now; empty if there is none."""
        # A request for a frame replaces the pending one.
        if isinstance(request, GetFrameRequest):
            return ""
        if len(self._pending) >= MAX_PENDING:
            return f"{MAX_PENDING} requests are pending: wait for their replies"
        if not self.robot.has_room:
            return "the simulation has not executed the commands before: wait, and send it again"
        return ""

    def _handle_request(self, request: Request) -> None:
        """Serve a request; one without a case here fails the type check."""
        match request:
            case GetFrameRequest():
                self.frame_sender.submit(request)
            case SpawnRequest():
                self._spawn(request)
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
            case GetStartPosesRequest(id_):
                start_poses = self._context.server_info.start_poses
                self.send_reply(StartPosesReply(id_, start_poses))
            case GetStatusRequest(id_):
                num_sent = self.frame_sender.num_sent
                self.send_reply(status_reply(id_, self._context, self.robot, num_sent=num_sent))
            case _:
                assert_never(request)

    def _spawn(self, request: SpawnRequest) -> None:
        # Reasons known here go to the client at once.
        reason = self.robot.find_spawn_error(request)
        if reason:
            self.send_reply(Error(request.id, reason))
        else:
            self.robot.spawn(request, self._pending.add(request.id))

    def _publish(self, request: PublishRequest) -> None:
        # Checked here, where the JSON of one client delays no robot.
        reason = find_note_error(request.name, request.text)
        if reason:
            self.send_reply(Error(request.id, reason))
        else:
            self.robot.publish(request, self._pending.add(request.id))

    def _replace_robot(self, reason: str) -> None:
        """Go on without a robot after a fault."""
        # Another object: late messages of the simulation about the old robot find it closed.
        self.robot = RobotSession(self._context.post, on_fault=self._replace_robot)
        self._pending.reject_all(reason)

    def _encode_reply(self, reply: Reply) -> bytes:
        try:
            return self._encode(reply)
        except LocalProtocolError:
            # Contained here, since every reply passes here: the client is told in any case.
            log_fault(log, "a reply of kind %s was not sent", reply.KIND)
            return self._encode(Error(getattr(reply, "id", 0), INTERNAL_FAULT))
