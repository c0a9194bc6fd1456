"""One direction of a relayed connection: bytes of one socket to another, without a queue."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

from catoptra_protocol.errors import RemoteProtocolError

# Receives the bytes of a read; returns those to relay, and the time in seconds until the next read.
# A RemoteProtocolError ends the connection.
InspectBytes = Callable[[bytes], tuple[bytes, float]]
EndCallback = Callable[[Exception | None], None]


class Relay:
    """Bytes from a source to a sink; reads nothing more until the sink has accepted all."""

    def __init__(
        self,
        source: socket.socket,
        sink: socket.socket,
        *,
        read_bytes: int,
        inspect: InspectBytes,
        on_end: EndCallback,
    ) -> None:
        """Begin to relay.

        Args:
            source: Non-blocking socket to read.
            sink: Non-blocking socket to write.
            read_bytes: Largest read.
            inspect: Inspects, and may change, the bytes of each read.
            on_end: Called with the reason when the source or the sink has ended.
        """
        self._loop = asyncio.get_running_loop()
        self._source = source
        self._sink = sink
        self._read_bytes = read_bytes
        self._inspect = inspect
        self._on_end = on_end
        self._pending = memoryview(b"")
        self._pause: asyncio.TimerHandle | None = None
        self._is_reading = self._is_writing = False
        self._update_callbacks()

    @property
    def is_blocked(self) -> bool:
        """Whether bytes wait for the sink; the end of the source is not noticed meanwhile."""
        return bool(self._pending)

    def close(self) -> None:
        """End all callbacks; to be called before the sockets are closed."""
        if self._pause is not None:
            self._pause.cancel()
        self._loop.remove_reader(self._source)
        self._loop.remove_writer(self._sink)

    def _receive(self) -> None:
        try:
            received = self._source.recv(self._read_bytes)
            data, wait_s = self._inspect(received)
        except BlockingIOError:
            return
        except (OSError, RemoteProtocolError) as error:
            self._on_end(error)
            return
        if not received:
            self._on_end(None)
            return
        self._pending = memoryview(data)
        if wait_s > 0.0:
            self._pause = self._loop.call_later(wait_s, self._end_pause)
        self._send_pending()

    def _send_pending(self) -> None:
        try:
            self._pending = self._pending[self._sink.send(self._pending) :]
        except BlockingIOError:
            pass
        except OSError as error:
            self._on_end(error)
            return
        self._update_callbacks()

    def _end_pause(self) -> None:
        self._pause = None
        self._update_callbacks()

    def _update_callbacks(self) -> None:
        """Wait for the sink while bytes are pending, else for the source unless it is paused."""
        # Backpressure: while the source is not read, TCP stops its sender.
        writes = bool(self._pending)
        reads = not writes and self._pause is None
        if reads != self._is_reading:
            self._is_reading = reads
            if reads:
                self._loop.add_reader(self._source, self._receive)
            else:
                self._loop.remove_reader(self._source)
        if writes != self._is_writing:
            self._is_writing = writes
            if writes:
                self._loop.add_writer(self._sink, self._send_pending)
            else:
                self._loop.remove_writer(self._sink)
