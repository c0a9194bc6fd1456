"""The simulation thread: owner of the clock and of all robots.

Other threads post events; the simulation replies by methods of `Client` and callbacks, and hands
over frame requests to be rendered elsewhere. A camera that no client requested is not captured.
Time advances in ticks of fixed length: with the wall clock (realtime), or only by steps (lockstep),
where equal seeds and commands give equal bytes.

* A thread for the simulation, one for rendering, one asyncio loop for sockets. One thread for the
  first two let the reports of 64 robots come every 0.35 s instead of 0.2 s.
* The work of clients takes a twentieth of each tick, 1 of 20 ms, by least use (`events.py`). One
  queue for all, drained before each tick, let four seconds of scans of one client stop the reports
  of all for sixteen. Under lockstep the order of arrival alone decides.
* A fault in the work of a client ends that work, a fault in a robot removes the robot; the others
  go on. Each is logged once, with its traceback, and reported to the client.
* STEP is an extension of the control protocol that old servers ignore. Under lockstep the
  simulation waits for each image, and each step ends with a whole sensor cycle and its `RES`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from enum import Enum
from typing import assert_never

from catoptra_protocol.errors import LocalProtocolError
from catoptra_server.frames.frame import Channel, FrameRendered, FrameRequest, FrameRequested
from catoptra_server.frames.mailbox import NS_PER_S, TICK_NS, TICK_S
from catoptra_server.runtime.faults import log_fault
from catoptra_server.simulation.events import (
    AccuracyTargetChanged,
    Client,
    ClientDisconnected,
    ClientWork,
    CommandReceived,
    Inbox,
    LandmarksRequested,
    NotePublished,
    PixelRequested,
    RejectedError,
    ResetRequested,
    SharedRobotDriven,
    SimulationEvent,
    StateRequested,
    StepRequested,
    StepResult,
    StopRequested,
    reply_fault,
)
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.frame_capture import FrameCapture

log = logging.getLogger(__name__)

# A server that lags by more, such as a suspended laptop, continues from the present instead of
# simulating all missed ticks at once.
_MAX_LAG_S = 0.5
# Ticks between two turns of capturing frames: where ticks take longer than 20 ms, 25 of them on
# end left each viewer among sixteen robots two frames a second.
_MAX_TICKS_PER_TURN = 4
# One step advances at most this far: no client occupies the simulation for longer.
_MAX_STEP_S = 60.0
# Wall time for the work of clients between two ticks of 20 ms: a twentieth, some ten commands. The
# rest is left to robots and sensors, and to the other threads, which share one interpreter: with
# 5 ms a flood of commands slowed the frames of all viewers to a third.
_WORK_BUDGET_S = 0.001


class ClockMode(Enum):
    """Source of simulation time."""

    REALTIME = "realtime"
    LOCKSTEP = "lockstep"


class Simulation:
    """The loop of the simulation thread; other threads may call `post` only."""

    def __init__(
        self,
        fleet: Fleet,
        *,
        clock: ClockMode,
        render: Callable[[FrameRequest], object],
        reject: Callable[[Channel, str], None],
        frame_skip: int = 1,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create a simulation at time 0.

        Args:
            fleet: Robots of the simulation.
            clock: Source of simulation time.
            render: Receives frame requests; FrameRendered is to be posted after each. Returns
                after the rendering under lockstep, at once otherwise.
            reject: Receives channels without a frame, and the reason; an empty one where robot
                or camera does not exist.
            frame_skip: Ticks between two frames of the image port, in real time.
            monotonic: Wall clock.
        """
        self._fleet = fleet
        self._clock = clock
        self._monotonic = monotonic
        self._inbox = Inbox(keep_order=clock is ClockMode.LOCKSTEP, monotonic=monotonic)
        self._work_left_s = _WORK_BUDGET_S
        self._time_ns = 0
        self._started_s = 0.0
        self._frame_capture = FrameCapture(
            fleet.cameras.compose_frame,
            render=render,
            reject=reject,
            is_realtime=clock is ClockMode.REALTIME,
            image_port_interval_s=frame_skip * TICK_S if frame_skip > 1 else 0.0,
            monotonic=monotonic,
        )
        self._is_stopped = False
        # Client of the step in progress.
        self._stepping: Client | None = None

    @property
    def _time_s(self) -> float:
        """Simulation time as the nearest float."""
        return self._time_ns / NS_PER_S

    def post(self, event: SimulationEvent) -> bool:
        """Queue an event, or serve one that needs no robot here; from any thread.

        Returns:
            False if the queue of the event's client is full: nothing more of that client is to be
            posted before its `resume_reading` is called.
        """
        if isinstance(event, FrameRendered):
            waiting = self._frame_capture.finish_frame(event.channel)
            if waiting is None:
                return True
            event = waiting
        if isinstance(event, FrameRequested) and self._capture_at_once(event):
            return True
        return self._inbox.post(event)

    def _capture_at_once(self, request: FrameRequested) -> bool:
        """Capture a requested frame without the simulation thread; from any thread."""
        # Not while work is waiting: a frame shows the effect of the commands before its request.
        # Under lockstep the simulation thread renders, so that its frames keep their place among
        # the commands.
        is_realtime = self._clock is ClockMode.REALTIME
        return (
            is_realtime
            and not self._inbox.has_work
            and self._frame_capture.capture_at_once(request)
        )

    def run(self, on_ready: Callable[[], None] = lambda: None) -> None:
        """Call `on_ready`, then handle events and advance time until StopRequested."""
        on_ready()
        self._started_s = self._monotonic()
        while True:
            self._inbox.wait(self._wait_timeout_s(), for_work=self._has_budget())
            self._handle_urgent_events()
            self._serve_waiting_work()
            if self._is_stopped:
                frames = self._frame_capture.count_frames()
                log.info("%d frames captured in %.1f s", frames, self._time_s)
                return
            if self._clock is ClockMode.REALTIME:
                self._catch_up()
            # Captured after all events: a frame shows the effect of the commands before it.
            self._frame_capture.capture_due_channels()

    def _wait_timeout_s(self) -> float | None:
        if self._clock is ClockMode.LOCKSTEP:
            return None  # time stands still, and all due channels are captured
        return max(0.0, self._started_s + self._time_s + TICK_S - self._monotonic())

    def _handle_urgent_events(self) -> None:
        for event in self._inbox.take_urgent():
            match event:
                case ClientDisconnected(client):
                    self._fleet.remote_control.halt_robots_driven_by(client, self._time_s)
                    self._remove_robot(client)
                    if client is self._stepping:
                        self._stepping = None
                case FrameRequested():
                    self._frame_capture.request_frame(event)
                case StopRequested():
                    self._is_stopped = True
                case _:
                    assert_never(event)

    def _serve_waiting_work(self) -> None:
        """Serve the work that is waiting now: all under lockstep, else within the budget."""
        # By the mark a flood does not prolong the turn: what arrives meanwhile waits for the next,
        # and a frame requested after some commands shows their effect.
        mark = self._inbox.newest_arrival
        while not self._is_stopped and self._has_budget() and self._inbox.has_work:
            # Before the work leaves the inbox, see `_capture_at_once`.
            self._frame_capture.invalidate()
            event = self._inbox.take_work(arrived_by=mark)
            if event is None:
                return
            begin_s = self._monotonic()
            self._serve(event)
            duration_s = self._monotonic() - begin_s
            self._inbox.charge(event.client, duration_s)
            self._work_left_s -= duration_s
            if self._inbox.has_urgent:
                self._handle_urgent_events()

    def _has_budget(self) -> bool:
        return self._work_left_s > 0.0 or self._clock is ClockMode.LOCKSTEP

    def _serve(self, event: ClientWork) -> None:
        """Execute the work of a client; a fault ends this work only."""
        try:
            self._execute(event)
        except Exception:
            log_fault(log, "%s of a client failed and was dropped", type(event).__name__)
            reply_fault(event, self._time_s)

    def _execute(self, event: ClientWork) -> None:
        # Without a default, as in `Fleet.execute`: a new event fails the type check here.
        match event:
            case CommandReceived(client, command):
                self._fleet.execute(client, command, self._time_s)
            case StepRequested():
                event.reply(self._step(event))
            case ResetRequested(client, reset_reply):
                self._remove_robot(client)
                reset_reply()
            case AccuracyTargetChanged():
                event.reply(*self._fleet.set_accuracy_target(event))
            case LandmarksRequested(_, channel, landmarks_reply):
                landmarks = self._fleet.cameras.compute_landmark_visibility(channel)
                landmarks_reply(self._time_s, landmarks)
            case PixelRequested(_, channel, point_px, pixel_reply):
                view = self._fleet.cameras.look_through_pixel(channel, point_px)
                pixel_reply(self._time_s, view)
            case StateRequested(_, robot, commands_after, ticks_after, state_reply):
                state_reply(self._time_s, self._fleet.get_state(robot, commands_after, ticks_after))
            case NotePublished() | SharedRobotDriven():
                event.reply(self._attempt(event))
            case _:
                assert_never(event)

    def _attempt(self, event: NotePublished | SharedRobotDriven) -> str:
        """Execute work that may be rejected; the reason, empty after success."""
        try:
            match event:
                case NotePublished(client, note):
                    self._fleet.publish(client, note, self._time_s)
                case SharedRobotDriven(client, robot, drive):
                    self._fleet.remote_control.drive(client, robot, drive, self._time_s)
        except (LocalProtocolError, RejectedError) as error:
            return str(error)
        return ""

    def _remove_robot(self, client: Client) -> None:
        self._frame_capture.invalidate()
        name = self._fleet.remove(client)
        if name is not None:
            self._frame_capture.remove_robot(name)

    def _step(self, step: StepRequested) -> StepResult:
        """Advance a lockstep clock, and read the client's whole sensor cycle."""
        failure = step.refusal or self._find_step_error(step)
        if failure:
            return StepResult(self._time_s, failure=failure)
        self._advance(step)
        readings = self._fleet.read_sensors(step.client, self._time_s)
        return StepResult(self._time_s, tuple(readings))

    def _find_step_error(self, step: StepRequested) -> str:
        if self._clock is not ClockMode.LOCKSTEP:
            return "no step: the server's clock is real time; run it with --clock lockstep"
        # A chained comparison is false for NaN, too.
        if not 0.0 <= step.duration_s <= _MAX_STEP_S:
            return f"no step: a step is 0 s to {_MAX_STEP_S:g} s, not {step.duration_s:g} s"
        # The clock is everybody's: a line that came here by mistake must not move it.
        if not step.is_declared and self._fleet.find_robot(step.client) is None:
            return "no step: this connection has no robot, and has not sent STEPPER"
        return ""

    def _catch_up(self) -> None:
        """Advance towards the wall clock by whole ticks, some of them before the next captures."""
        lag_s = self._monotonic() - self._started_s - self._time_s
        if lag_s > _MAX_LAG_S:
            log.warning("simulation lags by %.1f s: continuing from the present", lag_s)
            self._started_s += lag_s - TICK_S
            lag_s = TICK_S
        # Whole ticks: the remainder stays for the next call.
        for _ in range(min(int(lag_s / TICK_S), _MAX_TICKS_PER_TURN)):
            self._tick(TICK_NS)

    def _advance(self, step: StepRequested) -> None:
        """Advance by ticks, the last one shorter where the duration is no multiple."""
        # Rounded, not truncated: 2.01 s are 2009999999.9999998 ns.
        end_ns = self._time_ns + round(step.duration_s * NS_PER_S)
        self._stepping = step.client
        # A step ends early if its client leaves or the server stops.
        while self._time_ns < end_ns and self._stepping is not None and not self._is_stopped:
            self._tick(min(TICK_NS, end_ns - self._time_ns))
            if self._inbox.has_urgent:
                self._handle_urgent_events()
        self._stepping = None

    def _tick(self, duration_ns: int) -> None:
        self._time_ns += duration_ns
        self._frame_capture.begin_tick(self._time_s, self._started_s + self._time_s)
        self._work_left_s = _WORK_BUDGET_S
        self._fleet.step(duration_ns / NS_PER_S, self._time_s)
        self._fleet.deliver_due_reports(self._time_s)
        for client in self._fleet.pop_faulty_clients():
            # A second fault of the same robot in this tick finds no robot any more.
            self._remove_robot(client)
            client.disconnect("an internal fault of the server removed the robot: see its log")
