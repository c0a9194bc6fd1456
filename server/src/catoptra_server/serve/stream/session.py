"""The robot of one stream client, and the requests that wait for it: exactly one reply to each.

A session is a client of the simulation, like a TCP connection. Commands are posted in order, and
the simulation executes them in order, so that each confirmation belongs to the oldest request of
its kind. A fault of the robot closes the session; the client gets another. Reports in replies are
lines of the control protocol, without line ends.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.stream.replies import Error, Ok, Reply, SensorReports
from catoptra_protocol.stream.requests import DriveRequest, PublishRequest, SpawnRequest
from catoptra_protocol.usarsim.command_results import STATUS_OK, CommandResult
from catoptra_protocol.usarsim.commands import (
    Drive,
    Init,
    Note,
    ShareControl,
    line_from_command,
)
from catoptra_protocol.usarsim.reports import InitResult, Report, line_from_report
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import LruDict
from catoptra_server.simulation.events import (
    ClientDisconnected,
    CommandReceived,
    NotePublished,
    ResetRequested,
    SharedRobotDriven,
    SimulationEvent,
    StepRequested,
    StepResult,
)

log = logging.getLogger(__name__)
# Text for clients; the traceback is in the log.
INTERNAL_FAULT = "an internal fault ended this request: see the server's log"
SendReply = Callable[[Reply], None]
Post = Callable[[SimulationEvent], bool]
# Reports of 16 robots with 16 sensors each, at most 1 MB of lines.
_MAX_REPORTS = 256


class RobotSession:
    """At most one robot at a time, from the connection to its end or to a fault of the robot.

    The methods of `simulation.Client` may be called from any thread, all others on the loop.
    """

    def __init__(self, post: Post, *, on_fault: Callable[[str], None]) -> None:
        """Begin without a robot.

        Args:
            post: Hands an event to the simulation; False if the queue of this client is full.
            on_fault: Called with the reason after a fault has removed the robot; the session is
                closed then, and another one follows.
        """
        self._loop = asyncio.get_running_loop()
        self._post_event = post
        self._on_fault = on_fault
        self._is_closed = False
        # Without the others that are on their way, `has_robot` is the state of the simulation.
        self._pending_spawns: deque[tuple[PendingRequest, str]] = deque()
        self._num_pending_resets = 0
        self._confirmed_spawn: tuple[PendingRequest, InitResult] | None = None
        self._readings: dict[object, Report] = {}
        self.has_robot = False
        self.expects_robot = False
        """Whether there will be a robot once all posted commands are executed."""
        self.class_name = ""
        """Class of the robot, as the spawn request names it."""
        self.has_room = True
        """Whether the simulation accepts another command now."""

    def deliver(self, reports: Sequence[Report]) -> None:
        """Receive reports of the simulation."""
        self._call_on_loop(self._store_reports, tuple(reports))

    def finish_init(self, result: InitResult) -> None:
        """Receive the outcome of the oldest spawn; the first reports of a new robot follow."""
        if result.failure:
            self._call_on_loop(self._fail_spawn, result.failure)
        else:
            self._call_on_loop(self._confirm_spawn, result)

    def disconnect(self, reason: str) -> None:
        """Receive the removal of the robot by a fault."""
        self._call_on_loop(self._fail, reason)

    def resume_reading(self) -> None:
        """Receive that the simulation accepts commands again."""
        self._call_on_loop(self._set_has_room)

    def close(self) -> None:
        """End the session: waiting commands are dropped, the robot is removed."""
        if not self._is_closed:
            self._is_closed = True
            self._post_event(ClientDisconnected(self))

    def post(self, event: SimulationEvent) -> None:
        """Hand an event of this client to the simulation."""
        if not self._post_event(event):
            self.has_room = False

    def spawn(self, request: SpawnRequest, pending: PendingRequest) -> None:
        """Spawn a robot; what is known to be impossible here is rejected at once."""
        try:
            if self.expects_robot:
                raise LocalProtocolError(
                    "this client has its robot: reset first, or connect again for another"
                )
            init = _init_from_request(request)
        except LocalProtocolError as error:
            pending.reject(str(error))
            return
        self._pending_spawns.append((pending, request.class_name))
        self.expects_robot = True
        self.post(CommandReceived(self, init))

    def drive(self, request: DriveRequest) -> None:
        """Set the wheel speeds."""
        self.post(CommandReceived(self, _drive_from_request(request)))

    def drive_by_name(self, request: DriveRequest, pending: PendingRequest) -> None:
        """Set the wheel speeds of the robot that the request names."""
        drive = _drive_from_request(request)
        receive = self._outcome_receiver(pending)
        self.post(SharedRobotDriven(self, request.robot, drive, receive))

    def publish(self, request: PublishRequest, pending: PendingRequest) -> None:
        """Publish a note, which has been checked."""
        note = Note(request.name, request.text)
        self.post(NotePublished(self, note, self._outcome_receiver(pending)))

    def share_control(self, shared: bool) -> None:
        """Let other clients drive the robot, or no longer."""
        self.post(CommandReceived(self, ShareControl(shared)))

    def step(self, duration_s: float, pending: PendingRequest) -> None:
        """Advance a lockstep clock."""

        def receive(result: StepResult) -> None:
            self._call_on_loop(self._finish_step, pending, result)

        self.post(StepRequested(self, duration_s, receive))

    def reset(self, pending: PendingRequest) -> None:
        """Remove the robot."""
        # At once: commands behind the reset find no robot.
        self.has_robot = self.expects_robot = False
        self._num_pending_resets += 1
        self.post(ResetRequested(self, lambda: self._call_on_loop(self._finish_reset, pending)))

    def readings_reply(self, id_: int) -> Reply:
        """Reply with the newest reading of each sensor."""
        return SensorReports(id_, lines_from_reports(self._readings.values()))

    def _outcome_receiver(self, pending: PendingRequest) -> Callable[[str], None]:
        """Callback that replies with an error for a reason, with Ok for an empty one."""

        def receive(reason: str) -> None:
            self._call_on_loop(
                pending.reply, Error(pending.id, reason) if reason else Ok(pending.id)
            )

        return receive

    def _call_on_loop(self, function: Callable[..., None], *arguments: object) -> None:
        # Sockets and replies belong to the loop.
        self._loop.call_soon_threadsafe(self._run_if_open, function, *arguments)

    def _run_if_open(self, function: Callable[..., None], *arguments: object) -> None:
        if self._is_closed:
            return
        try:
            function(*arguments)
        except Exception:
            log_fault(log, "a reply of the simulation could not be handled")
            self._fail(INTERNAL_FAULT)

    def _store_reports(self, reports: tuple[Report, ...]) -> None:
        confirmed, self._confirmed_spawn = self._confirmed_spawn, None
        # Reports of a robot whose reset is on its way have no reader.
        if not self._num_pending_resets:
            for report in reports:
                # One entry per sensor: as many as the robot file lists.
                self._readings[type(report), getattr(report, "name", "")] = report
        if confirmed is not None:
            pending, result = confirmed
            lines = lines_from_reports(reports)
            pending.reply(SensorReports(pending.id, lines, result.moved_to, result.name))

    def _confirm_spawn(self, result: InitResult) -> None:
        pending, self.class_name = self._pending_spawns.popleft()
        self._confirmed_spawn = pending, result
        self.has_robot = not self._num_pending_resets

    def _fail_spawn(self, reason: str) -> None:
        # A spawn may also fail after its confirmation, at the first reading of a sensor.
        confirmed, self._confirmed_spawn = self._confirmed_spawn, None
        pending = confirmed[0] if confirmed else self._pending_spawns.popleft()[0]
        self.has_robot = False
        self.expects_robot = bool(self._pending_spawns)
        pending.reject(reason)

    def _finish_step(self, pending: PendingRequest, result: StepResult) -> None:
        if result.failure:
            pending.reject(result.failure)
            return
        self._store_reports(result.readings)
        reports = (*result.readings, CommandResult(result.time_s, "Step", "Clock", STATUS_OK))
        pending.reply(SensorReports(pending.id, lines_from_reports(reports)))

    def _finish_reset(self, pending: PendingRequest) -> None:
        self._num_pending_resets -= 1
        self._readings.clear()
        pending.reply(Ok(pending.id))

    def _fail(self, reason: str) -> None:
        # Commands behind the fault are dropped, so that none meets a client that knows nothing of
        # the fault.
        self.close()
        self._on_fault(reason)

    def _set_has_room(self) -> None:
        self.has_room = True


class PendingRequests:
    """The pending requests of one client, in the order of arrival."""

    def __init__(self, send_reply: SendReply) -> None:
        self.loop = asyncio.get_running_loop()
        self._send_reply = send_reply
        # A dict for its order; by object, since a client may repeat an id.
        self._requests: dict[PendingRequest, None] = {}

    def __len__(self) -> int:
        """Number of requests without a reply."""
        return len(self._requests)

    def add(self, id_: int) -> PendingRequest:
        """Add a request that will be answered later."""
        request = PendingRequest(id_, self)
        self._requests[request] = None
        return request

    def finish(self, request: PendingRequest, reply: Reply) -> None:
        """Send the reply to a request, unless answered before or cancelled."""
        if request in self._requests:
            del self._requests[request]
            self._send_reply(reply)

    def reject(self, id_: int, reason: str) -> None:
        """Send an error to the newest request of an id, pending or not."""
        for request in reversed(self._requests):
            if request.id == id_:
                request.reject(reason)
                return
        self._send_reply(Error(id_, reason))

    def reject_all(self, reason: str) -> None:
        """Send an error to every request."""
        for request in list(self._requests):
            request.reject(reason)

    def cancel_all(self) -> None:
        """Forget every request, without a reply: the client has disconnected."""
        self._requests.clear()


class PendingRequest:
    """One request; the first reply is sent, later ones are dropped."""

    def __init__(self, id_: int, requests: PendingRequests) -> None:
        self.id = id_
        self._requests = requests

    def reply(self, reply: Reply) -> None:
        """Send a reply; on the loop."""
        self._requests.finish(self, reply)

    def reject(self, reason: str) -> None:
        """Send an error; on the loop."""
        self.reply(Error(self.id, reason))

    def reply_from_thread(self, make_reply: Callable[[], Reply]) -> None:
        """Send a reply that is made on the loop; from any thread."""
        self._requests.loop.call_soon_threadsafe(self._make_and_reply, make_reply)

    def _make_and_reply(self, make_reply: Callable[[], Reply]) -> None:
        try:
            reply = make_reply()
        except Exception:
            log_fault(log, "the reply to a request failed")
            reply = Error(self.id, INTERNAL_FAULT)
        self.reply(reply)


class ReportLines:
    """Lines of the reports that several clients read, made once; on the loop."""

    def __init__(self) -> None:
        # By identity, since hashing a scan takes as long as making the line. The report is
        # kept, too, so that no other one gets the same identity.
        self._lines: LruDict[int, tuple[Report, tuple[str, ...]]] = LruDict(_MAX_REPORTS)

    def __len__(self) -> int:
        """Number of reports whose lines are kept."""
        return len(self._lines)

    def get(self, reports: Iterable[Report]) -> tuple[str, ...]:
        """Lines of reports; none for a report without a valid line."""
        return tuple(line for report in reports for line in self._get_one(report))

    def _get_one(self, report: Report) -> tuple[str, ...]:
        def make() -> tuple[Report, tuple[str, ...]]:
            return report, lines_from_reports([report])

        return self._lines.get_or_make(id(report), make)[1]


def lines_from_reports(reports: Iterable[Report]) -> tuple[str, ...]:
    """Lines of the control protocol, without reports that have no valid line."""
    lines: list[str] = []
    for report in reports:
        try:
            lines += line_from_report(report).decode("latin-1").splitlines()
        except LocalProtocolError as error:
            log.error("not sent: %s", error)
    return tuple(lines)


def _init_from_request(request: SpawnRequest) -> Init:
    """Command of a request. Raises LocalProtocolError for a name that no line can carry."""
    names = (request.class_name, request.name or "", request.start or "")
    if max(map(len, names)) > MAX_NAME_CHARS:
        raise LocalProtocolError(f"a name of more than {MAX_NAME_CHARS} characters")
    if not all(map(str.isprintable, names)):
        raise LocalProtocolError("a name with control characters")
    rotation_rad = request.rotation_rad or (0.0, 0.0, 0.0)
    init = Init(request.class_name, request.name, request.location_m, rotation_rad, request.start)
    # Names go into lines of the control protocol, where a brace would forge a block.
    line_from_command(init)
    return init


def _drive_from_request(request: DriveRequest) -> Drive:
    return Drive(request.left, request.right, request.normalized, halt_after_s=request.halt_after_s)
