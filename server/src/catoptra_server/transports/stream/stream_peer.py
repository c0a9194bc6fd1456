"""One client of the stream: its requests, its robot, its frames.

To the simulation it is a client like a TCP connection. Several requests may be pending; each gets
one reply with its id.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from typing import assert_never

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Ok, Reply, SensorReports
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetFrameRequest,
    GetReadingsRequest,
    ResetRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.commands import (
    Command,
    Drive,
    GetStartPoses,
    Init,
    Step,
    line_from_command,
)
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Report,
    StartPoses,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.simulation import ClientDisconnected, CommandReceived, SimulationEvent
from catoptra_server.transports.stream.frame_sender import FrameSender, SendMessage

log = logging.getLogger(__name__)

# More than any program that waits for its replies has pending.
_MAX_PENDING_STEPS = 16
_NO_ROBOT = "this client has no robot: spawn one first (a lost connection removes its robot)"

# Requests of a single client; StreamServer serves the others.
PeerRequest = (
    GetFrameRequest | SpawnRequest | StepRequest | ResetRequest | DriveRequest | GetReadingsRequest
)


class StreamPeer:
    """One client. `deliver` and `reject_init` may be called from any thread."""

    def __init__(
        self,
        send: SendMessage,
        post: Callable[[SimulationEvent], None],
        frame_sender: FrameSender,
    ):
        self._loop = asyncio.get_running_loop()
        self._send = send
        self._post = post
        self.frame_sender = frame_sender
        self._pending_spawn: int | None = None
        self._pending_steps: list[int] = []
        self._pending_resets: list[int] = []
        self._readings: dict[object, Report] = {}
        self._idle_heartbeats = 0
        self.has_robot = False

    def deliver(self, reports: Sequence[Report]) -> None:
        """Receive reports of the simulation."""
        # In the simulation's thread; sockets belong to the loop.
        self._loop.call_soon_threadsafe(self._handle_reports, tuple(reports))

    def reject_init(self) -> None:
        """Receive the rejection of a spawn."""
        self._loop.call_soon_threadsafe(self._fail_spawn)

    def disconnect(self) -> None:
        """Cancel pending work; the robot is removed from the world."""
        self.frame_sender.close()
        self._post(ClientDisconnected(self))

    def send_reply(self, reply: Reply) -> None:
        """Send a reply; lost if the client does not read."""
        self._send([bytes_from_message(reply)])

    def reset_idle_count(self) -> None:
        """Record a request: the client has read its earlier messages."""
        self._idle_heartbeats = 0

    def wants_heartbeat(self, max_idle: int) -> bool:
        """Whether a heartbeat is due; counts those without a pending request, up to `max_idle`."""
        # A client that waits reads, so its heartbeats cannot accumulate.
        if (
            self._pending_spawn is not None
            or self._pending_steps
            or self._pending_resets
            or self.frame_sender.has_pending_request
        ):
            return True
        self._idle_heartbeats += 1
        return self._idle_heartbeats <= max_idle

    def handle_request(self, request: PeerRequest) -> None:
        """Serve a request about the client's own robot and frames."""
        match request:
            case GetFrameRequest():
                self.frame_sender.submit(request)
            case SpawnRequest():
                self._spawn(request)
            case StepRequest(id_, time_s):
                self._step(id_, time_s)
            case ResetRequest(id_):
                self._reset(id_)
            case DriveRequest() | GetReadingsRequest() if not self.has_robot:
                self.send_reply(Error(request.id, _NO_ROBOT))
            case DriveRequest(id_, left, right, normalized):
                self._post_command(Drive(left, right, normalized))
                self.send_reply(Ok(id_))
            case GetReadingsRequest(id_):
                self.send_reply(SensorReports(id_, _lines_from_reports(self._readings.values())))
            case _:
                assert_never(request)

    def _post_command(self, command: Command) -> None:
        self._post(CommandReceived(self, command))

    def _spawn(self, request: SpawnRequest) -> None:
        init = Init(
            *(request.class_name, request.name, request.location_m),
            *(request.rotation_rad or (0.0, 0.0, 0.0), request.start),
        )
        # Reasons known here go to the client; the simulation can only reject.
        reason = self._find_spawn_error(init)
        if reason:
            self.send_reply(Error(request.id, reason))
            return
        self._pending_spawn = request.id
        self._post_command(init)

    def _find_spawn_error(self, init: Init) -> str:
        """Reason against a spawn before the simulation decides; empty if there is none."""
        if self.has_robot or self._pending_spawn is not None:
            return "this client has its robot: reset first, or connect again for another"
        if max(map(len, (init.class_name, init.name or "", init.start or ""))) > MAX_NAME_CHARS:
            return f"a name of more than {MAX_NAME_CHARS} characters"
        try:
            # Names go into lines of the control protocol, where a brace would forge a block.
            line_from_command(init)
        except LocalProtocolError as error:
            return str(error)
        return ""

    def _fail_spawn(self) -> None:
        id_, self._pending_spawn = self._pending_spawn, None
        if id_ is not None:
            reason = "no robot: unknown class or start pose; see class_names of get_status"
            self.send_reply(Error(id_, reason))

    def _step(self, id_: int, time_s: float) -> None:
        if self._reject_if_busy(id_):
            return
        self._pending_steps.append(id_)
        self._post_command(Step(time_s))

    def _reject_if_busy(self, id_: int) -> bool:
        # Steps and resets share the limit: both wait in the queue of the simulation.
        busy = len(self._pending_steps) + len(self._pending_resets) >= _MAX_PENDING_STEPS
        if busy:
            reason = f"{_MAX_PENDING_STEPS} steps or resets are pending: wait for their replies"
            self.send_reply(Error(id_, reason))
        return busy

    def _reset(self, id_: int) -> None:
        """Remove the robot.

        The reply is sent once the simulation has replied to a command after the removal.
        """
        if self._reject_if_busy(id_):
            return
        # To the simulation a reset is a disconnection: the robot is removed either way.
        self._post(ClientDisconnected(self))
        # The simulation has no reply to a disconnection; that of the next command follows the
        # removal, since events are processed in order.
        self._post_command(GetStartPoses())
        self._pending_resets.append(id_)
        self._readings.clear()
        self.has_robot, self._pending_spawn = False, None

    def _handle_reports(self, reports: tuple[Report, ...]) -> None:
        if self._pending_resets:
            self._handle_reports_in_reset(reports)
            return
        for report in reports:
            # One entry per sensor: as many as the robot file lists.
            self._readings[(type(report), getattr(report, "name", ""))] = report
        # RES comes last in the delivery of a step.
        if reports and isinstance(reports[-1], CommandResult):
            self._finish_step(reports, reports[-1])
        # A status is part of every first delivery, of a robot without sensors too.
        elif self._pending_spawn is not None and any(isinstance(r, VehicleStatus) for r in reports):
            id_, self._pending_spawn, self.has_robot = self._pending_spawn, None, True
            self.send_reply(SensorReports(id_, _lines_from_reports(reports)))

    def _handle_reports_in_reset(self, reports: tuple[Report, ...]) -> None:
        """Drop reports of the removed robot until the reply that follows its removal."""
        if any(isinstance(report, StartPoses) for report in reports):
            self.send_reply(Ok(self._pending_resets.pop(0)))
        elif reports and isinstance(reports[-1], CommandResult):
            self._finish_step((), reports[-1])

    def _finish_step(self, reports: tuple[Report, ...], result: CommandResult) -> None:
        if not self._pending_steps or result.type != "Step":
            return
        # Steps are executed in order, so the oldest pending one is the one that has ended.
        id_ = self._pending_steps.pop(0)
        if result.status == "OK":
            self.send_reply(SensorReports(id_, _lines_from_reports(reports)))
        else:
            reason = "no step: run the server with --clock lockstep, and step by 0 s to 60 s"
            self.send_reply(Error(id_, reason))


def _lines_from_reports(reports: Iterable[Report]) -> tuple[str, ...]:
    """Lines of the control protocol, without reports that have no valid line."""
    lines: list[str] = []
    for report in reports:
        try:
            lines += line_from_report(report).decode("latin-1").splitlines()
        except LocalProtocolError as error:
            log.error("not sent: %s", error)
    return tuple(lines)
