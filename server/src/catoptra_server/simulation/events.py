"""Events that other threads post to the simulation, and a connection as the simulation sees it.

Replies go by callback, also to work that raised an exception: every client that waits for a reply
gets one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, assert_never

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.command_results import STATUS_FAILED
from catoptra_protocol.usarsim.commands import Command, Drive, Init, Note, SetCommand
from catoptra_protocol.usarsim.reports import CommandResult, Report
from catoptra_server.frames.frame import CameraChannel, FrameRendered, FrameRequested
from catoptra_server.frames.plan.camera import OmniCameraSpec
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

    def confirm_spawn(self, name: str, moved_to: tuple[float, float, float] | None) -> None:
        """Record that INIT spawned a robot, before the first reports.

        Args:
            name: Name of the robot.
            moved_to: Location in metres if the requested one was not free, else None.
        """

    def reject_init(self, reason: str) -> None:
        """Record that INIT spawned no robot, for a reason in words."""

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
    reply: Callable[[OmniCameraSpec | Fault | None, str], None]
    """Receives the camera with the settings of the next frames, None without such a camera, and
    the camera's name."""


@dataclass(frozen=True, slots=True)
class StateRequested:
    """A client requests all robots, and the readings and notes of one."""

    client: Client
    robot: str
    """Exact name; empty for the robot that the image port displays."""
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
            client.reject_init(FAULT_REASON)
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
