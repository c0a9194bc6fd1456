"""One slot a channel between the drawing thread and the sockets' loop: the newest frame wins.

The drawing thread puts; coroutines wait for a frame newer than their last one. A frame waits in the
slot only while it is younger than a tick, or than a new one would take to draw: older than that, a
new one is asked for. Under lockstep a frame never waits: whoever asks gets a frame of this very
moment.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from functools import partial
from weakref import WeakValueDictionary

from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import Channel
from catoptra_server.simulation import FrameRendered, FrameRequested, SimulationEvent
from catoptra_server.simulation.loop import TICK_S


class ChannelUnavailableError(Exception):
    """A channel shows nothing: there is no such robot or camera (any more)."""


class Mailbox:
    """The slot. `ask` is called, from the loop, when a frame newer than a number is wanted."""

    def __init__(
        self,
        request_frame: Callable[[float], None],
        *,
        prefetch: bool,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._request_frame = request_frame
        self._prefetch = prefetch
        self._monotonic = monotonic
        self._newest: Frame | None = None
        self._is_frame_requested = False
        self._arrival: asyncio.Future[Frame] = self._loop.create_future()

    def put(self, frame: Frame) -> None:
        """Take a frame; who waits gets it."""
        self._newest = frame
        waiting, self._arrival = self._arrival, self._loop.create_future()
        waiting.set_result(frame)

    def fail(self) -> None:
        """Disappoint who waits."""
        self._newest = None
        self._is_frame_requested = False
        waiting, self._arrival = self._arrival, self._loop.create_future()
        waiting.set_exception(ChannelUnavailableError())
        waiting.exception()  # seen, also where nobody waits

    async def wait_for_newer(self, sequence: int) -> Frame:
        """Return a frame that is newer than a sequence number and fresh.

        Raises ChannelUnavailableError where there is nothing to show.

        When drawing ahead, the next one is asked for at once, so that it is drawn while this one
        travels: a client that keeps asking gets one after the other without a pause.
        """
        frame = self._fresh_frame(sequence)
        if frame is None:
            self._request_next()
            frame = await asyncio.shield(self._arrival)
        if self._prefetch:
            self._request_frame(frame.sequence)
        return frame

    def _request_next(self) -> None:
        if self._newest is not None:
            self._request_frame(self._newest.sequence)
        elif not self._is_frame_requested:
            # What was drawn before this mailbox was there is not known here: any will do.
            self._is_frame_requested = True
            self._request_frame(math.inf)

    def _fresh_frame(self, sequence: int) -> Frame | None:
        frame = self._newest
        if not self._prefetch or frame is None or frame.sequence <= sequence:
            return None
        # Within one tick a new frame would show the very same world.
        fresh_for_s = max(frame.render_duration_s, TICK_S)
        return frame if self._monotonic() - frame.finished_at_s <= fresh_for_s else None


class Mailboxes:
    """The mailboxes of all channels that somebody watches; one that nobody holds is gone."""

    def __init__(self, post: Callable[[SimulationEvent], None], *, prefetch: bool) -> None:
        self._post = post
        self._prefetch = prefetch
        self._loop = asyncio.get_running_loop()
        self._mailboxes: WeakValueDictionary[Channel, Mailbox] = WeakValueDictionary()

    def get(self, channel: Channel) -> Mailbox:
        """Return a channel's mailbox."""
        box = self._mailboxes.get(channel)
        if box is None:
            box = self._mailboxes[channel] = Mailbox(
                partial(self._request_frame, channel), prefetch=self._prefetch
            )
        return box

    def __len__(self) -> int:
        """Return how many channels are watched."""
        return len(self._mailboxes)

    def _request_frame(self, channel: Channel, newer_than: float) -> None:
        self._post(FrameRequested(newer_than, channel))

    def put(self, frame: Frame) -> None:
        """Put a frame into its channel's mailbox; called by the drawing thread."""
        self._post(FrameRendered(frame.channel))
        self._loop.call_soon_threadsafe(self._put_on_loop, frame)

    def fail(self, channel: Channel) -> None:
        """Disappoint who waits for a channel; called by the simulation thread."""
        self._loop.call_soon_threadsafe(self._fail_on_loop, channel)

    def _put_on_loop(self, frame: Frame) -> None:
        box = self._mailboxes.get(frame.channel)
        if box is not None:
            box.put(frame)

    def _fail_on_loop(self, channel: Channel) -> None:
        box = self._mailboxes.get(channel)
        if box is not None:
            box.fail()
