"""Messages to one client that wait for room in the queue of its socket, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import Enum, auto

from catoptra_server.frames.encode import Payload


class SendResult(Enum):
    """Outcome of a send."""

    SENT = auto()
    QUEUE_FULL = auto()
    DISCONNECTED = auto()


SendMessage = Callable[[list[Payload]], SendResult]

# Twice the pending requests of a client: a program that reads at all stays far below.
_MAX_MESSAGES = 128
# Of all waiting messages but the frame: eight of the largest replies.
_MAX_BYTES = 4 * 1024 * 1024


class Outbox:
    """Bounded queue in front of `send`; at most one frame of it waits."""

    def __init__(
        self,
        send: SendMessage,
        *,
        on_blocked: Callable[[], object],
        on_overflow: Callable[[], object],
    ) -> None:
        """Create an empty queue.

        Args:
            send: Sends a message at once or not at all.
            on_blocked: Called when the first message begins to wait; `flush` is to be called
                again and again from then on, until `is_blocked` is False.
            on_overflow: Called when the client reads too little, and the queue exceeds its bounds.
        """
        self._send = send
        self._on_blocked = on_blocked
        self._on_overflow = on_overflow
        self._waiting: deque[list[Payload]] = deque()
        self._frame: list[Payload] | None = None
        self._num_bytes = 0
        self._is_closed = False

    @property
    def is_blocked(self) -> bool:
        """Whether a message waits."""
        return bool(self._waiting)

    def send(self, message: bytes) -> None:
        """Send a reply of one part, after all that wait."""
        self._put([message])

    def send_frame(self, header: bytes, *payloads: Payload) -> None:
        """Send a frame, after all that wait; none may wait before, see `withdraw_frame`."""
        assert self._frame is None, "a waiting frame is withdrawn before the next one"
        parts: list[Payload] = [header, *payloads]
        if not self._put(parts):
            self._frame = parts

    def withdraw_frame(self) -> bool:
        """Remove a frame that waits; False if there is none."""
        if self._frame is None:
            return False
        # By identity: equal frames are compared byte by byte otherwise.
        self._waiting = deque(parts for parts in self._waiting if parts is not self._frame)
        self._frame = None
        return True

    def flush(self) -> bool:
        """Send waiting messages as far as there is room; whether any was sent."""
        num_before = len(self._waiting)
        while self._waiting:
            parts = self._waiting[0]
            if self._send(parts) is SendResult.QUEUE_FULL:
                break
            # The client may have disconnected, which closes the outbox.
            if self._is_closed:
                return False
            self._waiting.popleft()
            if parts is self._frame:
                self._frame = None
            else:
                self._num_bytes -= len(parts[0])
        return len(self._waiting) < num_before

    def close(self) -> None:
        """Drop all messages, later ones too: another client may have the same address."""
        self._is_closed = True
        self._waiting.clear()
        self._frame = None

    def _put(self, parts: list[Payload]) -> bool:
        """Send a message or let it wait; False if it waits."""
        if self._is_closed:
            return True
        self.flush()
        if not self._waiting and self._send(parts) is not SendResult.QUEUE_FULL:
            return True
        self._waiting.append(parts)
        if len(parts) == 1:
            self._num_bytes += len(parts[0])
        if len(self._waiting) == 1:
            self._on_blocked()
        if len(self._waiting) > _MAX_MESSAGES or self._num_bytes > _MAX_BYTES:
            self._on_overflow()
        return False
