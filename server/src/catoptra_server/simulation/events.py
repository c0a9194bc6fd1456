"""Events that other threads post to the simulation, and a connection as the simulation sees it.

Replies go by callback, also to work that raised an exception: every client that waits for a reply
gets one.

On their way to the simulation thread events are urgent ones, or the work of a client. The work of a
client waits in a queue of its own, of bounded length, so that a flood of one client neither delays
the others nor grows in memory. Within 1 % of the thread's time work keeps the order of arrival,
above that, behind all other. A client has 64 commands waiting at most, then none is read.
Departures and the server's end overtake all work.
"""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, assert_never

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.command_results import STATUS_FAILED
from catoptra_protocol.usarsim.commands import Command, Drive, Init, Note, SetCommand
from catoptra_protocol.usarsim.reports import CommandResult, InitResult, Report
from catoptra_server.frames.frame import (
    CameraChannel,
    Channel,
    FrameRendered,
    FrameRequested,
    ViewRequest,
)
from catoptra_server.runtime.queues import FairQueue
from catoptra_server.simulation.robot import FleetState
from catoptra_server.simulation.sight import LandmarkVisibility, PixelView


class Client(Protocol):
    """One connection that may have a robot.

    Methods may be called from any thread, and return at once: the simulation waits for no socket.
    """

    # Clients are keys of queues and robots, by identity.
    def __hash__(self) -> int: ...

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports, in order and in one piece."""

    def finish_init(self, result: InitResult) -> None:
        """Record the outcome of INIT, that of a new robot before its first reports."""

    def disconnect(self, reason: str) -> None:
        """End the connection: a fault has removed the robot."""

    def resume_reading(self) -> None:
        """Continue to post, after `post` returned False."""


class RejectedError(CatoptraError):
    """Work that a client may not have done; the message is the reason, in words for the client."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Reply to a request whose work raised an exception."""

    reason: str
    """Text for the client; the log has the traceback."""


@dataclass(frozen=True, slots=True)
class StepResult:
    """Reply to a step."""

    time_s: float
    """Simulation time after the step."""
    readings: tuple[Report, ...] = ()
    """Whole sensor cycle of the client's robot; empty without a robot or a step."""
    failure: str = ""
    """Reason why time did not advance; empty after a step."""


# Replies by callback, not by future: the simulation has no event loop, and each transport has
# its own way back to its thread. Callbacks return at once.
@dataclass(frozen=True, slots=True)
class CommandReceived:
    """A client sent a command other than STEP."""

    client: Client
    command: Command


@dataclass(frozen=True, slots=True)
class StepRequested:
    """A client advances the clock under lockstep."""

    client: Client
    duration_s: float
    reply: Callable[[StepResult], None]
    refusal: str = ""
    """Reason why the step is not to be executed, found in the queue; empty for none."""
    is_declared: bool = True
    """Whether the client has declared that it advances the clock; else it needs a robot."""


@dataclass(frozen=True, slots=True)
class ResetRequested:
    """A client gives the robot back, behind all waiting work."""

    client: Client
    reply: Callable[[], None]
    """Called after the removal."""
    is_last: bool = False
    """Whether the client sends nothing more: waiting work is served in the order of arrival,
    whatever time the client has used, so that place and name are free for a new connection."""


@dataclass(frozen=True, slots=True)
class LandmarksRequested:
    """A connection requests the landmarks in view of a camera."""

    client: Client
    channel: CameraChannel
    reply: Callable[[float, tuple[LandmarkVisibility, ...] | Fault | None], None]
    """Receives the simulation time and the landmarks, None without such a camera."""


@dataclass(frozen=True, slots=True)
class PixelRequested:
    """A connection requests the view at a point of a camera's image."""

    client: Client
    channel: CameraChannel
    point_px: tuple[float, float]
    """(u, v), pixel centres at +0.5."""
    reply: Callable[[float, PixelView | Fault | None], None]
    """Receives the simulation time and the view, None without such a camera."""


@dataclass(frozen=True, slots=True)
class AccuracyTargetChanged:
    """A client requests another accuracy target of its robot's camera, or the present one."""

    client: Client
    camera: str
    """Name of the camera in any case; empty for the robot's omnidirectional camera."""
    max_error_px: float | None
    """New tolerance; None leaves the present one."""
    budget_ms: float | None
    """New time budget of a frame; None leaves the present one."""
    reply: Callable[[ViewRequest | Fault | None, str], None]
    """Receives the view of the camera as the next frames have it, None without such a camera, and
    the camera's name."""


@dataclass(frozen=True, slots=True)
class StateRequested:
    """A client requests all robots, and the readings and notes of one."""

    client: Client
    robot: str
    """Exact name; empty for the robot that the image port displays."""
    commands_after: int | None
    """Number of the last known command; None for no commands."""
    ticks_after: float | None
    """Time of the last known tick; None for no ticks."""
    reply: Callable[[float, FleetState | Fault], None]
    """Receives the simulation time and the state."""


@dataclass(frozen=True, slots=True)
class NotePublished:
    """A client publishes a note about its robot, and waits for the outcome."""

    client: Client
    note: Note
    reply: Callable[[str], None]
    """Receives the reason if the note is refused, else an empty text."""


@dataclass(frozen=True, slots=True)
class SharedRobotDriven:
    """A client drives a robot by its name: its own, or one whose owner shares the control."""

    client: Client
    robot: str
    """Exact name."""
    drive: Drive
    reply: Callable[[str], None]
    """Receives the reason if the client may not, else an empty text."""


@dataclass(frozen=True, slots=True)
class ClientDisconnected:
    """A client is gone: waiting work is dropped and the robot removed, ahead of all work."""

    client: Client


@dataclass(frozen=True, slots=True)
class StopRequested:
    """The server shuts down."""


# Work waits in a queue by client. To add an event: its class, its line in one of the unions, and
# its case in `Simulation`, which the type check demands.
ClientWork = (
    CommandReceived
    | StepRequested
    | ResetRequested
    | LandmarksRequested
    | PixelRequested
    | AccuracyTargetChanged
    | StateRequested
    | NotePublished
    | SharedRobotDriven
)
# Handled ahead of all work; at most one of each kind a client or channel.
UrgentEvent = ClientDisconnected | FrameRequested | StopRequested
SimulationEvent = ClientWork | UrgentEvent | FrameRendered


# The log has the traceback, which would tell a client nothing.
FAULT_REASON = "an internal fault ended this request: see the server's log"


def reply_fault(event: ClientWork, time_s: float) -> None:
    """Reply to work that raised, wherever its client waits for a reply."""
    match event:
        case CommandReceived(client, Init()):
            client.finish_init(InitResult(time_s, failure=FAULT_REASON))
        case CommandReceived(client, SetCommand() as command):
            name = command.name or ""
            result = CommandResult(time_s, command.type, name, STATUS_FAILED)
            client.deliver([result])
        case CommandReceived():
            pass  # no other command has a reply
        case StepRequested():
            event.reply(StepResult(time_s, failure=FAULT_REASON))
        case ResetRequested(_, reply):
            reply()
        case AccuracyTargetChanged():
            event.reply(Fault(FAULT_REASON), event.camera)
        case LandmarksRequested() | PixelRequested() | StateRequested():
            event.reply(time_s, Fault(FAULT_REASON))
        case NotePublished() | SharedRobotDriven():
            event.reply(FAULT_REASON)
        case _:
            assert_never(event)


# Waiting work of one client above which its connection is not read: more than any program has on
# its way that reads its replies, and at most some 100 ms of work.
MAX_WAITING = 64
# A queue that was full is refilled from here on, not one by one.
_RESUME_AT = MAX_WAITING // 2
# Part of the simulation thread's time that a client may use before others come first: a fifth of
# the part of all clients together.
_CLIENT_SHARE = 0.01
# Simulated time in the waiting steps of one client, and of all: a client that leaves, or a server
# that stops, must not wait for hours of simulation.
_MAX_WAITING_STEP_S = 60.0
MAX_ALL_WAITING_STEP_S = 120.0


class Inbox:
    """Events of all clients. `post` may be called from any thread, all else from one."""

    def __init__(
        self, *, keep_order: bool, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        """Create an empty inbox.

        Args:
            keep_order: Take work in the order of arrival, as lockstep needs for equal bytes;
                otherwise clients above their share of the time wait behind the others.
            monotonic: Clock, seconds.
        """
        self._changed = threading.Condition()
        self._work: FairQueue[Client, ClientWork] = FairQueue(
            share=None if keep_order else _CLIENT_SHARE, monotonic=monotonic
        )
        self._urgent: list[UrgentEvent] = []
        self._frames: dict[Channel, float] = {}
        self._full: set[Client] = set()
        self._waiting_step_s: defaultdict[Client, float] = defaultdict(float)
        # Whether `wait` ends for work.
        self._waits_for_work = True

    def post(self, event: ClientWork | UrgentEvent) -> bool:
        """Add an event.

        Returns:
            False if the queue of the event's client is full: the client's `resume_reading` is
            called once there is room again.
        """
        superseded = None
        with self._changed:
            match event:
                case FrameRequested(newer_than, channel):
                    # One entry a channel, however many connections wait for its frames.
                    self._frames[channel] = max(newer_than, self._frames.get(channel, -1.0))
                case ClientDisconnected(client):
                    self._drop_work(client)
                    self._urgent.append(event)
                case StopRequested():
                    self._urgent.append(event)
                case _:
                    superseded = self._put_work(event)
            # Each wake-up takes the interpreter from the renderer: between the end of a tick's
            # budget and the next tick work wakes nobody.
            if self._waits_for_work or not isinstance(event, ClientWork):
                self._changed.notify()
            has_room = not isinstance(event, ClientWork) or self._has_room(event.client)
        if superseded is not None:
            superseded.reply(Fault("superseded by a newer request"), superseded.camera)
        return has_room

    def _has_room(self, client: Client) -> bool:
        if self._work.count(client) < MAX_WAITING:
            return True
        self._full.add(client)
        return False

    def _put_work(self, event: ClientWork) -> AccuracyTargetChanged | None:
        """Queue work; return the request that the work supersedes, if any."""
        newest = self._work.newest(event.client)
        match event, newest:
            case CommandReceived(command=Drive() as drive), CommandReceived(command=Drive() as old):
                if _sets_all_of(drive, old):
                    self._work.replace_newest(event.client, event)
                    return None
            case AccuracyTargetChanged(), AccuracyTargetChanged() if _sets_target_of(event, newest):
                self._work.replace_newest(event.client, event)
                return newest
            case SharedRobotDriven(), SharedRobotDriven() if _drives_over(event, newest):
                # One DRIVE for both requests, whose outcome is the same.
                self._work.replace_newest(event.client, _with_reply_of(newest, event))
                return None
            case ResetRequested(is_last=True), _:
                self._work.write_off(event.client)
            case StepRequested(), _:
                event = self._limit_step(event)
        self._work.put(event.client, event)
        return None

    def _limit_step(self, event: StepRequested) -> StepRequested:
        """The step, or one that fails in turn if too much simulated time waits already."""
        # Rejected in turn, not at once: replies keep the order of the requests.
        waiting_s = self._waiting_step_s
        duration_s = event.duration_s if event.duration_s > 0.0 else 0.0  # NaN, too
        own_s = waiting_s[event.client] + duration_s
        all_s = sum(waiting_s.values()) + duration_s
        if own_s > _MAX_WAITING_STEP_S or all_s > MAX_ALL_WAITING_STEP_S:
            limits = f"{_MAX_WAITING_STEP_S:g} s of a client, {MAX_ALL_WAITING_STEP_S:g} s of all"
            return replace(event, refusal=f"too much simulated time is waiting: at most {limits}")
        waiting_s[event.client] = own_s
        return event

    def _release_step(self, event: ClientWork) -> None:
        """Subtract a step that waits no longer."""
        if isinstance(event, StepRequested) and not event.refusal and event.duration_s > 0.0:
            left_s = self._waiting_step_s.pop(event.client, 0.0) - event.duration_s
            # Rounding of sums leaves nothing behind: without waiting work no time waits.
            if left_s > 0.0 and self._work.count(event.client):
                self._waiting_step_s[event.client] = left_s

    def _drop_work(self, client: Client) -> None:
        self._work.drop(client)
        self._full.discard(client)
        self._waiting_step_s.pop(client, None)

    def wait(self, timeout_s: float | None, *, for_work: bool) -> None:
        """Wait for an event.

        Args:
            timeout_s: Longest wait; None waits without limit.
            for_work: Whether work ends the wait; urgent events always do.
        """
        with self._changed:
            self._waits_for_work = for_work
            self._changed.wait_for(
                lambda: self._urgent or self._frames or (for_work and len(self._work)), timeout_s
            )

    @property
    def has_urgent(self) -> bool:
        """Whether an urgent event is waiting that is no frame request."""
        # A list is read atomically; called after every event and tick.
        return bool(self._urgent)

    @property
    def has_work(self) -> bool:
        """Whether work is waiting; from any thread."""
        return len(self._work) > 0

    def take_urgent(self) -> list[UrgentEvent]:
        """Remove and return all urgent events: in the order of arrival, frame requests last."""
        with self._changed:
            urgent, self._urgent = self._urgent, []
            frames, self._frames = self._frames, {}
        return [*urgent, *(FrameRequested(number, channel) for channel, number in frames.items())]

    @property
    def newest_arrival(self) -> int:
        """Mark of the newest work, for `take_work`."""
        return self._work.num_arrived

    def take_work(self, *, arrived_by: int | None = None) -> ClientWork | None:
        """Remove and return the next work; None if none is waiting that arrived by a mark."""
        with self._changed:
            taken = self._work.take(arrived_by=arrived_by)
            if taken is None:
                return None
            client, event = taken
            self._release_step(event)
            has_room_again = client in self._full and self._work.count(client) <= _RESUME_AT
            if has_room_again:
                self._full.discard(client)
        if has_room_again:
            client.resume_reading()
        return event

    def charge(self, client: Client, duration_s: float) -> None:
        """Record that work of a client took some time."""
        with self._changed:
            self._work.charge(client, duration_s)


def _sets_all_of(new: Drive, old: Drive) -> bool:
    """Whether a DRIVE leaves no effect of an older one that no tick has passed since."""
    return (
        (new.left is not None or old.left is None)
        and (new.right is not None or old.right is None)
        and (new.light is not None or old.light is None)
    )


def _drives_over(new: SharedRobotDriven, old: SharedRobotDriven) -> bool:
    """Whether a DRIVE by name leaves no effect of an older one that no tick has passed since."""
    return new.robot == old.robot and _sets_all_of(new.drive, old.drive)


def _with_reply_of(old: SharedRobotDriven, new: SharedRobotDriven) -> SharedRobotDriven:
    """The newer of two events, which replies to both."""

    def reply(reason: str) -> None:
        old.reply(reason)
        new.reply(reason)

    return replace(new, reply=reply)


def _sets_target_of(new: AccuracyTargetChanged, old: AccuracyTargetChanged) -> bool:
    """Whether a target replaces all values of an older one, of the same camera."""
    return (
        new.camera.lower() == old.camera.lower()
        and (new.max_error_px is not None or old.max_error_px is None)
        and (new.budget_ms is not None or old.budget_ms is None)
    )
