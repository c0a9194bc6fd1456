"""What is wanted of each channel, what is being drawn, and when it may be exposed again.

A channel has one shot under way at a time: what is drawn is never older than one drawing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from catoptra_server.frames.frame_request import CameraChannel, Channel

# Two times that differ by less than this are the same tick.
_SAME_TIME_S = 1e-9


class ChannelState:
    """One channel's shots: how many there were, and whether another one is wanted."""

    def __init__(self) -> None:
        self.sequence = 0
        self.is_requested = False
        self.is_rendering = False
        self._next_s = -math.inf

    def is_due(self, time_s: float) -> bool:
        """Return whether a shot is wanted and may be taken."""
        return self.is_requested and not self.is_rendering and time_s >= self._next_s - _SAME_TIME_S

    def start_frame(self, time_s: float, *, interval_s: float) -> int:
        """Take note of a shot; return its sequence number."""
        self.is_requested = False
        self.is_rendering = True
        self._next_s = time_s + interval_s
        self.sequence += 1
        return self.sequence


class CaptureScheduler:
    """The reels of all channels that somebody asked for."""

    def __init__(self) -> None:
        self._channels: dict[Channel, ChannelState] = {}

    def request_frame(self, channel: Channel, newer_than: float) -> None:
        """Take note that a shot is wanted, unless a newer one is drawn already."""
        reel = self._channels.setdefault(channel, ChannelState())
        reel.is_requested |= reel.sequence <= newer_than

    def finish_frame(self, channel: Channel) -> None:
        """Take note that a channel's shot is a frame now."""
        if channel in self._channels:
            self._channels[channel].is_rendering = False

    def remove(self, channel: Channel) -> None:
        """Forget a channel that nothing shows any more."""
        self._channels.pop(channel, None)

    def remove_idle(self, robot: str) -> None:
        """Forget the cameras of a robot that left; who still waits for one is refused when due."""
        for channel, reel in list(self._channels.items()):
            is_its = isinstance(channel, CameraChannel) and channel.robot == robot
            if is_its and not reel.is_requested:
                self.remove(channel)

    def due_channels(self, time_s: float) -> Iterator[tuple[Channel, ChannelState]]:
        """Iterate over what is to be exposed now."""
        return iter([(c, reel) for c, reel in self._channels.items() if reel.is_due(time_s)])

    def count_frames(self) -> int:
        """Return how many shots were taken of the channels that are there."""
        return sum(reel.sequence for reel in self._channels.values())
