"""Times at which channels capture frames: on request, one at a time, at most once an interval.

A channel has one frame in rendering at a time, so a request is never answered by a frame that
waited in a queue behind others of its channel.
"""

from __future__ import annotations

import math

from catoptra_server.frames.frame_request import CameraChannel, Channel

# Simulation time advances by ticks, in whole nanoseconds: sums of 0.02 s as floats would print
# 0.2 s as 0.1999.
NS_PER_S = 1_000_000_000
TICK_NS = 20_000_000
TICK_S = TICK_NS / NS_PER_S
# Two times closer than this are one tick: the interval was added as a float.
_SAME_TIME_S = 1e-9
# Channels above which those without a request are removed: variants of a camera come from clients.
MAX_CHANNELS = 512


class ChannelState:
    """Frames of one channel: their number, and whether another one is requested."""

    def __init__(self) -> None:
        self.sequence = 0
        self.is_requested = False
        self.is_rendering = False
        self._next_s = -math.inf

    def may_capture(self, time_s: float) -> bool:
        """Whether no frame is in rendering, and the interval has passed at a simulation time."""
        return not self.is_rendering and time_s >= self._next_s - _SAME_TIME_S

    def is_due(self, time_s: float) -> bool:
        """Whether a frame is requested and may be captured at a simulation time."""
        return self.is_requested and self.may_capture(time_s)

    def start_frame(self, time_s: float, *, interval_s: float) -> int:
        """Record the capture of a frame, and number it.

        Args:
            time_s: Simulation time of the exposure.
            interval_s: Simulation time until the channel may capture the next frame. One that is
                no multiple of a tick holds on average.

        Returns:
            Sequence number of the frame.
        """
        self.is_requested = False
        self.is_rendering = True
        # Late by less than a tick: from the time that was due, or 0.05 s would become 0.06 s.
        is_in_step = self._next_s <= time_s < self._next_s + TICK_S - _SAME_TIME_S
        self._next_s = (self._next_s if is_in_step else time_s) + interval_s
        self.sequence += 1
        return self.sequence


class CaptureScheduler:
    """States of all channels that were requested."""

    def __init__(self) -> None:
        self._channels: dict[Channel, ChannelState] = {}

    def find_state(self, channel: Channel) -> ChannelState:
        """State of a channel, which exists from here on."""
        state = self._channels.get(channel)
        if state is None:
            self._trim()
            state = self._channels[channel] = ChannelState()
        return state

    def _trim(self) -> None:
        """Remove channels that nobody waits for while there are too many, the oldest first."""
        if len(self._channels) < MAX_CHANNELS:
            return
        idle = [
            channel
            for channel, state in self._channels.items()
            if not (state.is_requested or state.is_rendering)
        ]
        for channel in idle[: len(self._channels) - MAX_CHANNELS + 1]:
            self.remove(channel)

    def request_frame(self, channel: Channel, newer_than: float) -> None:
        """Request a frame with a larger sequence number than `newer_than`."""
        state = self.find_state(channel)
        # A frame numbered above newer_than is being rendered already and will do.
        state.is_requested |= state.sequence <= newer_than

    def finish_frame(self, channel: Channel) -> ChannelState | None:
        """Record that the captured frame of a channel is rendered; None for a removed channel."""
        state = self._channels.get(channel)
        if state is not None:
            state.is_rendering = False
        return state

    def remove(self, channel: Channel) -> None:
        """Remove a channel whose robot or camera does not exist any more."""
        self._channels.pop(channel, None)

    def remove_idle(self, robot: str) -> None:
        """Remove the channels of a robot, except those with a request.

        A requested channel stays until due; the simulation then finds no camera and rejects the
        request, so that no connection waits forever.
        """
        for channel, state in list(self._channels.items()):
            belongs_to_robot = isinstance(channel, CameraChannel) and channel.robot == robot
            if belongs_to_robot and not state.is_requested:
                self.remove(channel)

    def due_channels(self, time_s: float) -> list[Channel]:
        """Channels to capture at a simulation time."""
        return [channel for channel, state in self._channels.items() if state.is_due(time_s)]

    def count_frames(self) -> int:
        """Count the captured frames of the present channels, for the log."""
        return sum(state.sequence for state in self._channels.values())
