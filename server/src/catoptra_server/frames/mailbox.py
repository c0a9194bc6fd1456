"""One slot a channel between render thread and event loop, holding the newest frame.

The render thread puts frames; coroutines wait for a frame newer than their last one. A frame stays
fresh while younger than a tick, or than rendering another one would take; after that a new one is
requested. Under lockstep no frame stays fresh: each request has a frame of the present time.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from functools import partial
from weakref import WeakValueDictionary

from catoptra_server.frames.capture_scheduler import TICK_S
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_events import FrameEvent, FrameRendered, FrameRequested
from catoptra_server.frames.frame_request import Channel, is_variant


class ChannelUnavailableError(Exception):
    """The channel has no frame: its argument is the reason.

    The reason is empty where no robot or camera belongs to the channel (any more).
    """

    def __init__(self, reason: str = "") -> None:
        super().__init__(reason)
        self.reason = reason


class Mailbox:
    """The newest frame of one channel, and the future of the next one."""

    def __init__(
        self,
        request_frame: Callable[[float], None],
        *,
        prefetch: bool,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create an empty slot; to be called from the event loop.

        Args:
            request_frame: Requests a frame with a larger sequence number.
            prefetch: Request the next frame as soon as one is taken, and serve fresh frames at
                once; False under lockstep.
            monotonic: Clock of `Frame.finished_at_s`.
        """
        self._loop = asyncio.get_running_loop()
        self._request_frame = request_frame
        self._prefetch = prefetch
        self._monotonic = monotonic
        self._newest: Frame | None = None
        # Sequence number of the request for the next frame; None if there is none so far.
        self._requested_after: float | None = None
        # One future a coroutine: a shared one would have to be shielded, at twice the cost.
        self._waiting: list[asyncio.Future[Frame]] = []

    @property
    def wants_next(self) -> bool:
        """Whether the next frame is to be requested before this one arrives; from any thread."""
        return self._prefetch and bool(self._waiting)

    def put(self, frame: Frame, *, is_next_requested: bool = False) -> None:
        """Store a frame and resume all waiting coroutines.

        Args:
            frame: The newest frame.
            is_next_requested: Whether a frame newer than this one has been requested already.
        """
        self._newest = frame
        self._requested_after = frame.sequence if is_next_requested else None
        for future in self._take_waiting():
            future.set_result(frame)

    def fail(self, reason: str) -> None:
        """Raise ChannelUnavailableError with a reason in all waiting coroutines."""
        self._newest = self._requested_after = None
        for future in self._take_waiting():
            future.set_exception(ChannelUnavailableError(reason))

    def _take_waiting(self) -> list[asyncio.Future[Frame]]:
        """Futures of the coroutines that wait now; those of cancelled ones are dropped."""
        waiting, self._waiting = self._waiting, []
        return [future for future in waiting if not future.done()]

    async def wait_for_newer(self, sequence: int) -> Frame:
        """Wait for a fresh frame with a larger sequence number.

        Raises:
            ChannelUnavailableError: The channel has no frame.
        """
        frame = self._fresh_frame(sequence)
        if frame is None:
            # Sequence numbers from before this mailbox are unknown here; infinity requests a new
            # frame whatever the channel's number is.
            self._request_after(self._newest.sequence if self._newest else math.inf)
            frame = await self._next_arrival()
        if self._prefetch:
            # The next frame is rendered while this one travels: a client that requests frame after
            # frame receives them without a pause.
            self._request_after(frame.sequence)
        return frame

    async def _next_arrival(self) -> Frame:
        """Wait for the next frame, whatever its number."""
        future: asyncio.Future[Frame] = self._loop.create_future()
        self._waiting.append(future)
        try:
            return await future
        except asyncio.CancelledError:
            # At once: with the next frame is too late for a client that changes its mind often.
            if future in self._waiting:
                self._waiting.remove(future)
            raise

    def _request_after(self, sequence: float) -> None:
        """Request a frame with a larger sequence number, once for all coroutines."""
        # Each request has an answer, a frame or a failure, and wakes the simulation's thread.
        if self._requested_after != sequence:
            self._requested_after = sequence
            self._request_frame(sequence)

    def _fresh_frame(self, sequence: int) -> Frame | None:
        frame = self._newest
        if not self._prefetch or frame is None or frame.sequence <= sequence:
            return None
        # Within one tick a new frame would show the same world; and a frame younger than its own
        # rendering time is newer than any frame that could be requested now.
        fresh_for_s = max(frame.render_duration_s, TICK_S)
        return frame if self._monotonic() - frame.finished_at_s <= fresh_for_s else None


class Mailboxes:
    """Mailboxes of all channels that a connection displays."""

    def __init__(self, post: Callable[[FrameEvent], object], *, prefetch: bool) -> None:
        """Create no mailbox yet.

        Args:
            post: Hands an event to the simulation thread; called from any thread.
            prefetch: See `Mailbox`.
        """
        self._post = post
        self._prefetch = prefetch
        self._loop = asyncio.get_running_loop()
        # Weak: connections hold their mailboxes, and a channel without connections costs nothing.
        self._mailboxes: WeakValueDictionary[Channel, Mailbox] = WeakValueDictionary()

    def get(self, channel: Channel) -> Mailbox:
        """Mailbox of a channel, created on first use; the caller keeps the reference."""
        mailbox = self._mailboxes.get(channel)
        if mailbox is None:
            request = partial(self._request_frame, channel)
            # Viewers look at a variant now and then: a frame ahead would mostly be for nobody.
            prefetch = self._prefetch and not is_variant(channel)
            mailbox = self._mailboxes[channel] = Mailbox(request, prefetch=prefetch)
        return mailbox

    def __len__(self) -> int:
        """Number of channels with a connection."""
        return len(self._mailboxes)

    def _request_frame(self, channel: Channel, newer_than: float) -> None:
        self._post(FrameRequested(newer_than, channel))

    def put(self, frame: Frame) -> None:
        """Put a frame into the mailbox of its channel; called by the render thread."""
        # Posted before the frame arrives: the next capture need not wait for the event loop. Nor
        # its request: a coroutine that waits takes this frame, and would request the next one.
        self._post(FrameRendered(frame.channel))
        mailbox = self._mailboxes.get(frame.channel)
        is_next_requested = mailbox is not None and mailbox.wants_next
        if is_next_requested:
            self._request_frame(frame.channel, frame.sequence)
        self._loop.call_soon_threadsafe(self._put_on_loop, frame, is_next_requested)

    def fail(self, channel: Channel, reason: str) -> None:
        """Reject all requests for a channel, from any thread.

        Args:
            channel: The channel.
            reason: Text for clients; empty where robot or camera does not exist.
        """
        self._loop.call_soon_threadsafe(self._fail_on_loop, channel, reason)

    def fail_frame(self, channel: Channel, reason: str) -> None:
        """Reject all requests for a channel whose frame could not be rendered."""
        self._post(FrameRendered(channel))
        self.fail(channel, reason)

    def _put_on_loop(self, frame: Frame, is_next_requested: bool) -> None:
        mailbox = self._mailboxes.get(frame.channel)
        if mailbox is not None:
            mailbox.put(frame, is_next_requested=is_next_requested)

    def _fail_on_loop(self, channel: Channel, reason: str) -> None:
        mailbox = self._mailboxes.get(channel)
        if mailbox is not None:
            mailbox.fail(reason)
