"""One client of the stream: its requests, its robot, its frames.

To the simulation it is a client like a TCP connection. Several requests may be on their way; each
is answered by one message that carries its id.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.wire.commands import (
    Command,
    Drive,
    GetStartPoses,
    Init,
    Step,
    line_from_command,
)
from catoptra_protocol.wire.limits import MAX_NAME_CHARS
from catoptra_protocol.wire.reports import (
    Report,
    Result,
    StartPoses,
    VehicleStatus,
    line_from_report,
)
from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Answer, Done, Refused, Reported
from catoptra_protocol.wire.stream_requests import (
    AskDrive,
    AskFrame,
    AskReadings,
    AskReset,
    AskSpawn,
    AskStep,
    Request,
)
from catoptra_server.simulation import Asked, Left
from catoptra_server.simulation import Request as SimulationRequest
from catoptra_server.transports.zmq_stream_frames import FrameSlot, Send

log = logging.getLogger(__name__)

# Steps or resets on their way: more than any program that waits for its answers has.
_MAX_STEPS = 16
_NO_ROBOT = "there is no robot of yours: spawn one first (a lost connection takes its robot along)"


class StreamPeer:
    """One client. `deliver` and `refuse_init` may be called from any thread."""

    def __init__(self, send: Send, post: Callable[[SimulationRequest], None], slot: FrameSlot):
        self._loop = asyncio.get_running_loop()
        self._send = send
        self._post = post
        self.slot = slot
        self._spawning: int | None = None
        self._steps: list[int] = []
        self._resets: list[int] = []
        self._readings: dict[object, Report] = {}
        self._idle_pulses = 0
        self.has_robot = False

    def deliver(self, reports: Sequence[Report]) -> None:
        """Take reports of the simulation."""
        self._loop.call_soon_threadsafe(self._delivered, tuple(reports))

    def refuse_init(self) -> None:
        """Take note that no robot was spawned."""
        self._loop.call_soon_threadsafe(self._spawn_refused)

    def leave(self) -> None:
        """End everything that goes on for this client; its robot leaves the world."""
        self.slot.close()
        self._post(Left(self))

    def answer(self, answer: Answer) -> None:
        """Send an answer; one that the client does not take is lost."""
        self._send([bytes_from_message(answer)])

    def heard(self) -> None:
        """Take note that the client asked for something: it has read what came before."""
        self._idle_pulses = 0

    def takes_pulse(self, most_idle: int) -> bool:
        """Count a pulse; return whether it is due: one that waits for nothing gets a few only."""
        if self._spawning is not None or self._steps or self._resets or self.slot.is_waiting:
            return True
        self._idle_pulses += 1
        return self._idle_pulses <= most_idle

    def serve(self, request: Request) -> None:
        """Serve what concerns the client's own robot and frames."""
        match request:
            case AskFrame():
                self.slot.ask(request)
            case AskSpawn():
                self._spawn(request)
            case AskStep(id_, time_s):
                self._step(id_, time_s)
            case AskReset(id_):
                self._reset(id_)
            case _ if not self.has_robot:
                self.answer(Refused(request.id, _NO_ROBOT))
            case AskDrive(id_, left, right, normalized):
                self._ask(Drive(left, right, normalized))
                self.answer(Done(id_))
            case AskReadings(id_):
                self.answer(Reported(id_, _lines(self._readings.values())))

    def _ask(self, command: Command) -> None:
        self._post(Asked(self, command))

    def _spawn(self, request: AskSpawn) -> None:
        init = Init(
            *(request.class_name, request.name, request.location_m),
            *(request.rotation_rad, request.start),
        )
        reason = self._cannot_spawn(init)
        if reason:
            self.answer(Refused(request.id, reason))
            return
        self._spawning = request.id
        self._ask(init)

    def _cannot_spawn(self, init: Init) -> str:
        """Return why a robot cannot even be asked for; empty if it can."""
        if self.has_robot or self._spawning is not None:
            return "this client has its robot: reset first, or connect again for another"
        if max(map(len, (init.class_name, init.name or "", init.start or ""))) > MAX_NAME_CHARS:
            return f"a name of more than {MAX_NAME_CHARS} characters"
        try:
            line_from_command(init)  # names go into lines of the control protocol
        except LocalProtocolError as error:
            return str(error)
        return ""

    def _spawn_refused(self) -> None:
        id_, self._spawning = self._spawning, None
        if id_ is not None:
            self.answer(Refused(id_, "no robot: unknown class, or no such start; ask for status"))

    def _step(self, id_: int, time_s: float) -> None:
        if self._is_too_busy(id_):
            return
        self._steps.append(id_)
        self._ask(Step(time_s))

    def _is_too_busy(self, id_: int) -> bool:
        busy = len(self._steps) + len(self._resets) >= _MAX_STEPS
        if busy:
            said = f"{_MAX_STEPS} steps or resets are on their way: wait for their answers"
            self.answer(Refused(id_, said))
        return busy

    def _reset(self, id_: int) -> None:
        """Remove the robot; done once the simulation has answered something that comes after."""
        if self._is_too_busy(id_):
            return
        self._post(Left(self))
        self._ask(GetStartPoses())
        self._resets.append(id_)
        self._readings.clear()
        self.has_robot, self._spawning = False, None

    def _delivered(self, reports: tuple[Report, ...]) -> None:
        if self._resets:
            self._delivered_in_reset(reports)
            return
        for report in reports:
            # One entry a sensor: as many as the robot's own file lists.
            self._readings[(type(report), getattr(report, "name", ""))] = report
        if reports and isinstance(reports[-1], Result):
            self._stepped(reports, reports[-1])
        elif self._spawning is not None and any(isinstance(r, VehicleStatus) for r in reports):
            id_, self._spawning, self.has_robot = self._spawning, None, True
            self.answer(Reported(id_, _lines(reports)))

    def _delivered_in_reset(self, reports: tuple[Report, ...]) -> None:
        """Drop what the removed robot still said; take the answer that its removal is over."""
        if any(isinstance(report, StartPoses) for report in reports):
            self.answer(Done(self._resets.pop(0)))
        elif reports and isinstance(reports[-1], Result):
            self._stepped((), reports[-1])

    def _stepped(self, reports: tuple[Report, ...], result: Result) -> None:
        if not self._steps or result.type != "Step":
            return
        id_ = self._steps.pop(0)
        if result.status == "OK":
            self.answer(Reported(id_, _lines(reports)))
        else:
            self.answer(Refused(id_, "no step: run the server with --clock lockstep, and step by "
                                     "0 s to a minute"))  # fmt: skip


def _lines(reports: Iterable[Report]) -> tuple[str, ...]:
    """Return reports as lines of the control protocol, without those that cannot be sent."""
    lines: list[str] = []
    for report in reports:
        try:
            lines += line_from_report(report).decode("latin-1").splitlines()
        except LocalProtocolError as error:
            log.error("not sent: %s", error)
    return tuple(lines)
