"""Captures of the frames that clients request: each of an instant of its own, or not drawn again.

Composing a frame needs robots, which belong to the simulation thread. A composition holds until a
tick or a command changes something; until then any thread captures further frames from there, each
of the instant of its exposure (`instants.py`): a renderer draws several frames in a tick of 20 ms,
and each wake-up of the simulation for one cost 0.3 ms of processor time.

In real time a request for what has been drawn waits until something changes, and gets the last
frame once more with the next tick, under a new number: viewers count on frames that keep coming.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable

from catoptra_protocol.errors import DomainError
from catoptra_server.frames.frame import (
    Channel,
    FrameComposition,
    FrameRequest,
    FrameRequested,
    ImagePortChannel,
)
from catoptra_server.frames.instants import rewind, show_same
from catoptra_server.frames.mailbox import TICK_S, CaptureScheduler, ChannelState
from catoptra_server.runtime.faults import log_fault
from catoptra_server.simulation.events import FAULT_REASON

log = logging.getLogger(__name__)


class FrameCapture:
    """Channels with their compositions. For the simulation thread, unless a method says more."""

    def __init__(
        self,
        compose: Callable[[Channel], FrameComposition | None],
        *,
        render: Callable[[FrameRequest], object],
        reject: Callable[[Channel, str], None],
        is_realtime: bool,
        image_port_interval_s: float = 0.0,
        monotonic: Callable[[], float],
    ) -> None:
        """Create no channel yet.

        Args:
            compose: Composes the frame of a channel; None without such a robot or camera.
            render: Receives frame requests.
            reject: Receives channels without a frame, and the reason; an empty one where robot
                or camera does not exist.
            is_realtime: Whether channels keep their intervals, frames have instants, and nothing
                is drawn twice; without, each request has a frame of the tick.
            image_port_interval_s: Shortest simulation time between two frames of the image port.
            monotonic: Wall clock.
        """
        self._compose = compose
        self._render = render
        self._reject = reject
        self._is_realtime = is_realtime
        self._image_port_interval_s = image_port_interval_s
        self._monotonic = monotonic
        # Guards all below; held for no call of a function above.
        self._lock = threading.Lock()
        self._scheduler = CaptureScheduler()
        self._time_s = 0.0
        self._ticked_at_s = -math.inf
        self._compositions: dict[Channel, FrameComposition | None] = {}
        # Channels captured in this tick, and in the one before.
        self._captured: set[Channel] = set()
        self._captured_before: set[Channel] = set()
        self._composed_ahead: set[Channel] = set()

    def capture_at_once(self, request: FrameRequested) -> bool:
        """Capture a requested frame from its present composition; from any thread.

        Returns:
            False if the simulation thread has to compose the frame, and nothing was recorded. True
            also where a frame in rendering will do, or the channel has to wait for its frame or
            interval.
        """
        with self._lock:
            state = self._scheduler.find_state(request.channel)
            if state.sequence > request.newer_than:
                return True
            composition = self._compositions.get(request.channel)
            if composition is None and state.may_capture(self._time_s):
                return False
            state.is_requested = True
            frame = composition and self._start_frame(request.channel, state, composition)
        if frame:
            self._render(frame)
        return True

    def finish_frame(self, channel: Channel) -> FrameRequested | None:
        """Record that the captured frame of a channel is rendered; from any thread.

        Returns:
            The request that has waited for this frame, now to be served; None without one.
        """
        with self._lock:
            state = self._scheduler.finish_frame(channel)
            if state is None or not state.is_requested:
                return None
            return FrameRequested(state.sequence, channel)

    def request_frame(self, request: FrameRequested) -> None:
        """Record a request for `capture_due_channels`."""
        with self._lock:
            self._scheduler.request_frame(request.channel, request.newer_than)

    def begin_tick(self, time_s: float, at_s: float = -math.inf) -> None:
        """Forget all compositions: robots move until a simulation time.

        Args:
            time_s: The simulation time.
            at_s: That time on the wall clock, in real time.
        """
        with self._lock:
            self._time_s, self._ticked_at_s = time_s, at_s
            self._compositions.clear()
            # A channel with a frame in each of the last ticks will have one in this, too.
            self._composed_ahead = self._captured & self._captured_before
            self._captured, self._captured_before = set(), self._captured

    def invalidate(self) -> None:
        """Forget all compositions: something else than a tick changes robots."""
        with self._lock:
            self._compositions.clear()

    def capture_due_channels(self) -> None:
        """Capture the frames of all channels that are due, and compose those that soon will be."""
        with self._lock:
            due = self._scheduler.due_channels(self._time_s)
            ahead, self._composed_ahead = self._composed_ahead, set()
        for channel in due:
            self._capture(channel)
        for channel in ahead:
            self._find_composition(channel)

    def remove_robot(self, name: str) -> None:
        """Forget the channels of a robot that nobody waits for."""
        with self._lock:
            self._scheduler.remove_idle(name)

    def count_frames(self) -> int:
        """Count the captured frames of the present channels, for the log."""
        return self._scheduler.count_frames()

    def _capture(self, channel: Channel) -> None:
        composition = self._find_composition(channel)
        if composition is None:
            return
        with self._lock:
            frame = self._start_frame(channel, self._scheduler.find_state(channel), composition)
        if frame:
            self._render(frame)

    def _find_composition(self, channel: Channel) -> FrameComposition | None:
        """Composition of a channel, once as long as nothing moves; a rejection without one."""
        if channel in self._compositions:
            return self._compositions[channel]
        try:
            composition = self._compose(channel)
        # A request that does not suit the camera is no fault.
        except DomainError as error:
            self._remove(channel, str(error))
            return None
        except Exception:
            log_fault(log, "the frame of %s could not be composed", channel)
            self._remove(channel, FAULT_REASON)
            return None
        if composition is None:
            self._remove(channel, "")
            return None
        with self._lock:
            self._compositions[channel] = composition
        return composition

    def _remove(self, channel: Channel, reason: str) -> None:
        with self._lock:
            self._scheduler.remove(channel)
        self._reject(channel, reason)

    def _start_frame(
        self, channel: Channel, state: ChannelState, composition: FrameComposition
    ) -> FrameRequest | None:
        """Request of a frame that begins now; None if the channel is not due. Under the lock."""
        if not state.is_due(self._time_s):
            return None
        now_s, time_s, repeats = self._monotonic(), self._time_s, None
        interval_s = self._min_interval_s(channel, composition)
        if self._is_realtime:
            # Exposures at intervals keep to the ticks.
            lag_s = 0.0 if interval_s else max(0.0, self._ticked_at_s + TICK_S - now_s)
            time_s, composition = time_s - lag_s, rewind(composition, lag_s)
            if state.composition and show_same(state.composition, composition):
                if state.captured_s == self._time_s:
                    return None
                repeats = state.sequence
        self._captured.add(channel)
        sequence = state.start_frame(self._time_s, interval_s=interval_s)
        state.composition = composition
        return FrameRequest(channel, sequence, time_s, now_s, composition, repeats)

    def _min_interval_s(self, channel: Channel, composition: FrameComposition) -> float:
        if not self._is_realtime:
            return 0.0
        is_image_port = isinstance(channel, ImagePortChannel)
        interval_s = self._image_port_interval_s if is_image_port else 0.0
        return max(composition.min_interval_s, interval_s)
