"""One slot between the drawing thread and the sockets' loop: the newest frame wins.

The drawing thread puts; coroutines wait for a frame newer than their last one. A frame waits in the
slot only while it is younger than a tick, or than a new one would take to draw: older than that, a
new one is asked for. Under lockstep a frame never waits: whoever asks gets a frame of this very
moment.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from catoptra_server.encode import Frame
from catoptra_server.simulation.loop import TICK_S


class Mailbox:
    """The slot. `ask` is called, from the loop, when a frame newer than a number is wanted."""

    def __init__(
        self,
        ask: Callable[[int], None],
        *,
        ahead: bool,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._ask = ask
        self._ahead = ahead
        self._monotonic = monotonic
        self._newest: Frame | None = None
        self._arrival: asyncio.Future[Frame] = self._loop.create_future()

    def put(self, frame: Frame) -> None:
        """Put a frame; called by the drawing thread."""
        self._loop.call_soon_threadsafe(self._arrived, frame)

    def _arrived(self, frame: Frame) -> None:
        self._newest = frame
        waiting, self._arrival = self._arrival, self._loop.create_future()
        waiting.set_result(frame)

    async def newer_than(self, sequence: int) -> Frame:
        """Return a frame that is newer than a sequence number and fresh.

        When drawing ahead, the next one is asked for at once, so that it is drawn while this one
        travels: a client that keeps asking gets one after the other without a pause.
        """
        frame = self._waiting_frame(sequence)
        if frame is None:
            self._ask(self._newest.sequence if self._newest else 0)
            frame = await asyncio.shield(self._arrival)
        if self._ahead:
            self._ask(frame.sequence)
        return frame

    def _waiting_frame(self, sequence: int) -> Frame | None:
        frame = self._newest
        if not self._ahead or frame is None or frame.sequence <= sequence:
            return None
        # Within one tick a new frame would show the very same world.
        fresh_for_s = max(frame.drawn_s, TICK_S)
        return frame if self._monotonic() - frame.finished_s <= fresh_for_s else None
