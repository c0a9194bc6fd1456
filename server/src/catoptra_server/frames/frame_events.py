"""Events about frames that mailboxes post to the simulation thread."""

from __future__ import annotations

import math

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame_request import IMAGE_PORT, Channel


@dataclass(frozen=True, slots=True)
class FrameRequested:
    """A connection waits for a frame of a channel."""

    newer_than: float = math.inf
    """Sequence number of the newest frame already at hand; a frame captured after that number and
    still being rendered satisfies the request, infinity always has a new one captured."""
    channel: Channel = IMAGE_PORT


@dataclass(frozen=True, slots=True)
class FrameRendered:
    """A requested frame is finished: the channel may capture the next one."""

    channel: Channel


# The events of `Mailboxes`, a part of those of the simulation.
FrameEvent = FrameRequested | FrameRendered
