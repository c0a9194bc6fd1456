"""The simulation: one thread that owns the clock and the robots.

Others talk to it by posting requests; it answers by calling `Client` methods and by handing over
shots to be drawn elsewhere. A camera that nobody asked is not drawn. Time runs in ticks of fixed
length: with the wall clock (realtime), or only when a client asks for a step (lockstep), and then
the same seed and commands give the same bytes.
"""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable
from enum import Enum

from catoptra_protocol.usarsim.commands import Step
from catoptra_protocol.usarsim.reports import CommandResult, Report
from catoptra_server.frames.capture_scheduler import CaptureScheduler, ChannelState
from catoptra_server.frames.frame_request import (
    Channel,
    FrameComposition,
    FrameRequest,
    ImagePortChannel,
)
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.simulation_events import (
    AccuracyTargetChanged,
    Client,
    ClientDisconnected,
    CommandReceived,
    FrameRendered,
    FrameRequested,
    LandmarksRequested,
    SimulationEvent,
    StopRequested,
)

log = logging.getLogger(__name__)

# Time is counted in whole nanoseconds: a sum of floats would print 0.2 s as 0.1999.
_NS_PER_S = 1_000_000_000
TICK_NS = 20_000_000
TICK_S = TICK_NS / _NS_PER_S
# A server that falls behind by more than this (a suspended laptop) goes on from now instead of
# catching up tick by tick.
_MAX_LAG_S = 0.5
# One STEP advances at most this far: a client cannot occupy the simulation for longer.
MAX_STEP_S = 60.0


class ClockMode(Enum):
    """How simulation time passes."""

    REALTIME = "realtime"
    LOCKSTEP = "lockstep"


class Simulation:
    """The loop of the simulation thread; only `post` may be called by others.

    draw: takes a shot; whoever draws it posts Drawn. refuse: told of a channel that shows nothing.
    frame_skip: the screen is exposed at most every so many ticks of the wall clock.
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        clock: ClockMode,
        render: Callable[[FrameRequest], object],
        reject: Callable[[Channel], None],
        frame_skip: int = 1,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._fleet = fleet
        self._clock = clock
        self._render = render
        self._reject = reject
        self._image_port_interval_s = frame_skip * TICK_S if frame_skip > 1 else 0.0
        self._monotonic = monotonic
        self._events: queue.SimpleQueue[SimulationEvent] = queue.SimpleQueue()
        self._time_ns = 0
        self._started_s = 0.0
        self._scheduler = CaptureScheduler()

    @property
    def _time_s(self) -> float:
        """Return the double that is nearest to the time."""
        return self._time_ns / _NS_PER_S

    def post(self, event: SimulationEvent) -> None:
        """Hand over a request; from any thread."""
        self._events.put(event)

    def run(self, on_ready: Callable[[], None] = lambda: None) -> None:
        """Say that it is ready, serve requests and let time pass, until Stop."""
        on_ready()
        self._started_s = self._monotonic()
        while True:
            for request in self._next_events():
                if isinstance(request, StopRequested):
                    log.info("%d shots in %.1f s", self._scheduler.count_frames(), self._time_s)
                    return
                self._handle(request)
            if self._clock is ClockMode.REALTIME:
                self._catch_up()
            for channel, reel in self._scheduler.due_channels(self._time_s):
                self._capture(channel, reel)

    def _next_events(self) -> list[SimulationEvent]:
        """Return all requests that wait; block until the next tick if there is none."""
        try:
            requests = [self._events.get(timeout=self._wait_timeout_s())]
        except queue.Empty:
            return []
        while not self._events.empty():
            requests.append(self._events.get())
        return requests

    def _wait_timeout_s(self) -> float | None:
        if self._clock is ClockMode.LOCKSTEP:
            return None  # whatever was due is exposed
        return max(0.0, self._started_s + self._time_s + TICK_S - self._monotonic())

    def _handle(self, event: SimulationEvent) -> None:
        match event:
            case CommandReceived(client, Step(time_s)):
                client.deliver(self._step(client, time_s))
            case CommandReceived(client, command):
                self._fleet.execute(client, command, self._time_s)
            case ClientDisconnected(client):
                name = self._fleet.remove(client)
                if name is not None:
                    self._scheduler.remove_idle(name)
            case FrameRequested(newer_than, channel):
                self._scheduler.request_frame(channel, newer_than)
            case FrameRendered(channel):
                self._scheduler.finish_frame(channel)
            case AccuracyTargetChanged():
                event.reply(*self._fleet.set_accuracy_target(event))
            case LandmarksRequested(channel, reply):
                reply(self._time_s, self._fleet.compute_landmark_visibility(channel))

    def _step(self, client: Client, time_s: float) -> list[Report]:
        """Advance a lockstep clock; the answer ends with the client's sensors and RES."""
        possible = self._clock is ClockMode.LOCKSTEP and 0.0 <= time_s <= MAX_STEP_S
        if possible:
            self._advance(time_s)
        status = "OK" if possible else "Failed"
        readings = self._fleet.read_sensors(client, self._time_s) if possible else []
        return [*readings, CommandResult(self._time_s, "Step", "Clock", status)]

    def _catch_up(self) -> None:
        """Advance to the wall clock by whole ticks."""
        behind = self._monotonic() - self._started_s - self._time_s
        if behind > _MAX_LAG_S:
            log.warning("the simulation is %.1f s behind: it goes on from now", behind)
            self._started_s += behind - TICK_S
            behind = TICK_S
        for _ in range(int(behind / TICK_S)):
            self._tick(TICK_NS)

    def _advance(self, duration_s: float) -> None:
        """Advance by ticks and a last shorter one."""
        end_ns = self._time_ns + round(duration_s * _NS_PER_S)
        while self._time_ns < end_ns:
            self._tick(min(TICK_NS, end_ns - self._time_ns))

    def _tick(self, duration_ns: int) -> None:
        self._time_ns += duration_ns
        self._fleet.step(duration_ns / _NS_PER_S, self._time_s)
        self._fleet.deliver_due_reports(self._time_s)

    def _capture(self, channel: Channel, state: ChannelState) -> None:
        """Capture what a channel shows now and have it drawn."""
        scenery = self._fleet.compose_frame(channel)
        if scenery is None:
            self._scheduler.remove(channel)
            self._reject(channel)
            return
        sequence = state.start_frame(
            self._time_s, interval_s=self._min_interval_s(channel, scenery)
        )
        self._render(FrameRequest(channel, sequence, self._time_s, self._monotonic(), scenery))

    def _min_interval_s(self, channel: Channel, composition: FrameComposition) -> float:
        if self._clock is ClockMode.LOCKSTEP:
            return 0.0
        on_screen = isinstance(channel, ImagePortChannel)
        return max(composition.min_interval_s, self._image_port_interval_s if on_screen else 0.0)
