"""When a channel captures a frame, and the slot of the newest one for all connections.

`CaptureScheduler` counts frames in simulation time, for the thread that captures. `Mailboxes` stand
between render thread and event loop: coroutines wait for a frame newer than their last one.

* Pull: a frame is rendered because a client requested one. A channel has one frame in rendering at
  a time, so no request is answered by a frame that waited behind others of its channel.
* A frame is fresh while younger than a tick, or than rendering another one would take. So a slow
  client gets fresh frames, and a fast one never waits for sockets. Under lockstep no frame stays
  fresh: each request has a frame of the present time.
* The next frame is requested where the last one is put, by the render thread itself: through the
  simulation thread each frame cost 0.2 ms more.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from weakref import WeakValueDictionary

from catoptra_server.frames.frame import (
    CameraChannel,
    Channel,
    Frame,
    FrameComposition,
    FrameEvent,
    FrameRendered,
    FrameRequest,
    FrameRequested,
    is_variant,
)

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
        self.composition: FrameComposition | None = None
        """What the last frame shows."""
        self.captured_s = -math.inf
        """Simulation time of its capture."""
        self._next_s = -math.inf

    def may_capture(self, time_s: float) -> bool:
        """Whether no frame is in rendering, and the interval has passed at a simulation time."""
        return not self.is_rendering and time_s >= self._next_s - _SAME_TIME_S

    def is_due(self, time_s: float) -> bool:
        """Whether a frame is requested and may be captured at a simulation time."""
        return self.is_requested and self.may_capture(time_s)

    def start_frame(self, time_s: float, *, interval_s: float) -> int:
        """Record and number the capture of a frame.

        Args:
            time_s: Simulation time of the exposure.
            interval_s: Simulation time until the channel may capture the next frame. One that is
                no multiple of a tick holds on average.

        Returns:
            Sequence number of the frame.
        """
        self.is_requested = False
        self.is_rendering = True
        self.captured_s = time_s
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
        self._waiting: list[tuple[Hashable, asyncio.Future[Frame]]] = []
        # Clients that have the newest frame.
        self._served: set[Hashable] = set()

    @property
    def newest(self) -> Frame | None:
        """The newest frame; from any thread."""
        return self._newest

    @property
    def wants_next(self) -> bool:
        """Whether the next frame is to be requested before this one arrives; from any thread."""
        return self._prefetch and bool(self._waiting)

    def find_clients(self) -> set[Hashable] | None:
        """Clients that the next frame is for; None if nobody waits for it. From any thread."""
        waiting = {client for client, _ in tuple(self._waiting)}
        if not waiting and not self._prefetch:
            return None
        return waiting | self._served

    def request_again(self) -> None:
        """Request the frame that coroutines wait for, after another one was not drawn."""
        self._requested_after = None
        if self._waiting:
            self._request_after(math.inf)

    def put(self, frame: Frame, *, is_next_requested: bool = False) -> None:
        """Store a frame and resume all waiting coroutines.

        Args:
            frame: The newest frame.
            is_next_requested: Whether a frame newer than this one has been requested already.
        """
        self._newest = frame
        self._requested_after = frame.sequence if is_next_requested else None
        self._served = {client for client, _ in self._waiting}
        for future in self._take_waiting():
            future.set_result(frame)

    def fail(self, reason: str) -> None:
        """Raise ChannelUnavailableError with a reason in all waiting coroutines."""
        self._newest = self._requested_after = None
        for future in self._take_waiting():
            future.set_exception(ChannelUnavailableError(reason))

    def _take_waiting(self) -> list[asyncio.Future[Frame]]:
        """Futures of the coroutines that wait now, without cancelled ones."""
        waiting, self._waiting = self._waiting, []
        return [future for _, future in waiting if not future.done()]

    async def wait_for_newer(self, sequence: int, client: Hashable = None) -> Frame:
        """Wait for a fresh frame with a larger sequence number.

        Args:
            sequence: Number of the last frame that the client has.
            client: Account that pays for the frame, with the others that wait for it.

        Raises:
            ChannelUnavailableError: The channel has no frame.
        """
        frame = self._fresh_frame(sequence)
        if frame is None:
            # Sequence numbers from before this mailbox are unknown here; infinity requests a new
            # frame whatever the channel's number is.
            self._request_after(self._newest.sequence if self._newest else math.inf)
            frame = await self._next_arrival(client)
        self._served.add(client)
        if self._prefetch:
            # The next frame is rendered while this one travels: a client that requests frame after
            # frame receives them without a pause.
            self._request_after(frame.sequence)
        return frame

    async def _next_arrival(self, client: Hashable) -> Frame:
        """Wait for the next frame, of any number."""
        future: asyncio.Future[Frame] = self._loop.create_future()
        self._waiting.append((client, future))
        try:
            return await future
        except asyncio.CancelledError:
            # At once: with the next frame is too late for a client that often changes channels.
            if (client, future) in self._waiting:
                self._waiting.remove((client, future))
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

    def __init__(
        self,
        post: Callable[[FrameEvent], object],
        *,
        prefetch: bool,
        resolve: Callable[[Channel], Channel] = lambda channel: channel,
    ) -> None:
        """Create no mailbox yet.

        Args:
            post: Hands an event to the simulation thread; called from any thread.
            prefetch: See `Mailbox`.
            resolve: The one channel of a camera, whatever names a request has for it.
        """
        self.resolve = resolve
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

    def repeat(self, request: FrameRequest) -> bool:
        """Put the newest frame of a channel once more, as a request numbers and dates it.

        Called by the render thread.

        Returns:
            False where the mailbox no longer has the frame that the request repeats.
        """
        mailbox = self._mailboxes.get(request.channel)
        newest = mailbox and mailbox.newest
        if not newest or newest.sequence != request.repeats:
            return False
        self.put(
            replace(
                newest,
                sequence=request.sequence,
                time_s=request.time_s,
                exposed_at_s=request.exposed_at_s,
                finished_at_s=time.monotonic(),
            )
        )
        return True

    def find_clients(self, channel: Channel) -> set[Hashable] | None:
        """Clients that a frame of a channel is for; None if nobody waits. From any thread."""
        mailbox = self._mailboxes.get(channel)
        return None if mailbox is None else mailbox.find_clients()

    def drop_frame(self, channel: Channel) -> None:
        """Record that a captured frame of a channel was not drawn, since nobody waited for it."""
        self._post(FrameRendered(channel))
        self._loop.call_soon_threadsafe(self._drop_on_loop, channel)

    def _drop_on_loop(self, channel: Channel) -> None:
        mailbox = self._mailboxes.get(channel)
        if mailbox is not None:
            mailbox.request_again()

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
