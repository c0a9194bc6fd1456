"""The simulation thread: owner of the clock and of all robots.

Other threads post events; the simulation replies by methods of `Client` and hands over frame
requests to be rendered elsewhere. A camera that no client requested is not captured. Time advances
in ticks of fixed length: with the wall clock (realtime), or only by STEP (lockstep), where equal
seeds and commands give equal bytes.
"""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable
from enum import Enum
from typing import assert_never

from catoptra_protocol.usarsim.commands import Step
from catoptra_protocol.usarsim.reports import CommandResult, Report
from catoptra_server.frames.capture_scheduler import (
    NS_PER_S,
    TICK_NS,
    TICK_S,
    CaptureScheduler,
    ChannelState,
)
from catoptra_server.frames.frame_events import FrameRendered, FrameRequested
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
    LandmarksRequested,
    SimulationEvent,
    StopRequested,
)

log = logging.getLogger(__name__)

# A server that lags by more, such as a suspended laptop, continues from the present instead of
# simulating all missed ticks at once.
_MAX_LAG_S = 0.5
# One STEP advances at most this far: no client occupies the simulation for longer.
MAX_STEP_S = 60.0


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
        reject: Callable[[Channel], None],
        frame_skip: int = 1,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create a simulation at time 0.

        Args:
            fleet: Robots of the simulation.
            clock: Source of simulation time.
            render: Receives frame requests; FrameRendered is to be posted after each. Returns
                after the rendering under lockstep, at once otherwise.
            reject: Receives channels whose robot or camera does not exist.
            frame_skip: Ticks between two frames of the image port, in real time.
            monotonic: Wall clock.
        """
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
        self._is_stopped = False

    @property
    def _time_s(self) -> float:
        """Simulation time as the nearest float."""
        return self._time_ns / NS_PER_S

    def post(self, event: SimulationEvent) -> None:
        """Queue an event; from any thread."""
        self._events.put(event)

    def run(self, on_ready: Callable[[], None] = lambda: None) -> None:
        """Call `on_ready`, then handle events and advance time until StopRequested."""
        on_ready()
        self._started_s = self._monotonic()
        while True:
            for event in self._next_events():
                self._handle(event)
                if self._is_stopped:
                    frames = self._scheduler.count_frames()
                    log.info("%d frames captured in %.1f s", frames, self._time_s)
                    return
            if self._clock is ClockMode.REALTIME:
                self._catch_up()
            # Captured after all events: a frame shows the effect of the commands before it.
            for channel, state in self._scheduler.due_channels(self._time_s):
                self._capture(channel, state)

    def _next_events(self) -> list[SimulationEvent]:
        """All queued events; waits for one until the next tick."""
        try:
            events = [self._events.get(timeout=self._wait_timeout_s())]
        except queue.Empty:
            return []
        # All of them: events that arrived during a long tick are handled before the next.
        while not self._events.empty():
            events.append(self._events.get())
        return events

    def _wait_timeout_s(self) -> float | None:
        if self._clock is ClockMode.LOCKSTEP:
            return None  # time stands still, and all due channels are captured
        return max(0.0, self._started_s + self._time_s + TICK_S - self._monotonic())

    def _handle(self, event: SimulationEvent) -> None:
        # Without a default, as in `Fleet.execute`: a new event fails the type check here.
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
            case LandmarksRequested(camera_channel, reply):
                reply(self._time_s, self._fleet.compute_landmark_visibility(camera_channel))
            case StopRequested():
                self._is_stopped = True
            case _:
                assert_never(event)

    def _step(self, client: Client, time_s: float) -> list[Report]:
        """Advance a lockstep clock.

        Returns:
            The client's whole sensor cycle, and a RES that marks the end of the reply.
        """
        # A chained comparison is false for NaN, too.
        is_possible = self._clock is ClockMode.LOCKSTEP and 0.0 <= time_s <= MAX_STEP_S
        if is_possible:
            self._advance(time_s)
        status = "OK" if is_possible else "Failed"
        readings = self._fleet.read_sensors(client, self._time_s) if is_possible else []
        return [*readings, CommandResult(self._time_s, "Step", "Clock", status)]

    def _catch_up(self) -> None:
        """Advance to the wall clock by whole ticks."""
        lag_s = self._monotonic() - self._started_s - self._time_s
        if lag_s > _MAX_LAG_S:
            log.warning("simulation lags by %.1f s: continuing from the present", lag_s)
            self._started_s += lag_s - TICK_S
            lag_s = TICK_S
        # Whole ticks: the remainder stays for the next call.
        for _ in range(int(lag_s / TICK_S)):
            self._tick(TICK_NS)

    def _advance(self, duration_s: float) -> None:
        """Advance by ticks, the last one shorter where the duration is no multiple."""
        # Rounded, not truncated: 2.01 s are 2009999999.9999998 ns.
        end_ns = self._time_ns + round(duration_s * NS_PER_S)
        while self._time_ns < end_ns:
            self._tick(min(TICK_NS, end_ns - self._time_ns))

    def _tick(self, duration_ns: int) -> None:
        self._time_ns += duration_ns
        self._fleet.step(duration_ns / NS_PER_S, self._time_s)
        self._fleet.deliver_due_reports(self._time_s)

    def _capture(self, channel: Channel, state: ChannelState) -> None:
        """Capture the frame of a due channel and hand it over to be rendered."""
        composition = self._fleet.compose_frame(channel)
        if composition is None:
            self._scheduler.remove(channel)
            self._reject(channel)
            return
        interval_s = self._min_interval_s(channel, composition)
        sequence = state.start_frame(self._time_s, interval_s=interval_s)
        self._render(FrameRequest(channel, sequence, self._time_s, self._monotonic(), composition))

    def _min_interval_s(self, channel: Channel, composition: FrameComposition) -> float:
        # A limit of the load in real time; under lockstep each request has its frame.
        if self._clock is ClockMode.LOCKSTEP:
            return 0.0
        is_image_port = isinstance(channel, ImagePortChannel)
        interval_s = self._image_port_interval_s if is_image_port else 0.0
        return max(composition.min_interval_s, interval_s)
