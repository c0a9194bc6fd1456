"""Channels whose frames fail: rejected for a while, longer after each failure.

A failed frame costs more than others, since renderers are made anew: a channel that always fails
must not take the time of those that work.
"""

from __future__ import annotations

from collections.abc import Callable

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame_request import Channel

_FIRST_PAUSE_S = 1.0
_MAX_PAUSE_S = 60.0
# Channels are named by clients.
_MAX_CHANNELS = 64


@dataclass(frozen=True, slots=True)
class _Pause:
    until_s: float
    length_s: float
    reason: str


class ChannelBackoff:
    """Pauses of failing channels."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._pauses: dict[Channel, _Pause] = {}

    def find_reason(self, channel: Channel) -> str:
        """Reason why no frame of a channel is to be rendered now; empty for none."""
        pause = self._pauses.get(channel)
        return pause.reason if pause and self._monotonic() < pause.until_s else ""

    def record_failure(self, channel: Channel, reason: str) -> None:
        """Pause a channel, twice as long as the last time."""
        last = self._pauses.pop(channel, None)
        length_s = min(2.0 * last.length_s, _MAX_PAUSE_S) if last else _FIRST_PAUSE_S
        while len(self._pauses) >= _MAX_CHANNELS:
            self._pauses.pop(next(iter(self._pauses)))
        self._pauses[channel] = _Pause(self._monotonic() + length_s, length_s, reason)

    def record_success(self, channel: Channel) -> None:
        """End the pauses of a channel."""
        self._pauses.pop(channel, None)
