"""A TCP proxy in threads of this process, which passes messages on through a mutation.

Loopback only, on a free port. A message of the control port is a line with its end; one of the
image port is, towards the client, a frame with its header; towards the server, and on the stream,
whatever arrived at once. The end of either side, orderly or by RST, ends the other side alike.
"""

from __future__ import annotations

import re
import select
import socket
import socketserver
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from conformance.conversation_file import Address
from conformance.mutation import ConnectionMutation, MutateBytes

# Splits the bytes that arrived into whole messages and the rest.
SplitMessages = Callable[[bytes], tuple[list[bytes], bytes]]

_READ_BYTES = 256 * 1024
# Clients end lines with CR, LF or both; an empty line between CR and LF is no message to anybody.
_COMMAND = re.compile(rb"[^\r\n]*[\r\n]+")
_FRAME_HEADER = struct.Struct(">BI")
_ZERO_LINGER = struct.pack("ii", 1, 0)


def split_lines(data: bytes) -> tuple[list[bytes], bytes]:
    """Lines that end with LF, and the rest."""
    *lines, rest = data.split(b"\n")
    return [line + b"\n" for line in lines], rest


def split_commands(data: bytes) -> tuple[list[bytes], bytes]:
    """Lines that end with CR, LF or both, and the rest."""
    # Up to the last end alone: on a long text without one the pattern takes quadratic time.
    end = max(data.rfind(b"\r"), data.rfind(b"\n")) + 1
    return _COMMAND.findall(data[:end]), data[end:]


def split_frames(data: bytes) -> tuple[list[bytes], bytes]:
    """Frames of the image port, and the rest."""
    frames = []
    while len(data) >= _FRAME_HEADER.size:
        end = _FRAME_HEADER.size + _FRAME_HEADER.unpack_from(data)[1]
        if len(data) < end:
            break
        frames.append(data[:end])
        data = data[end:]
    return frames, data


def split_nothing(data: bytes) -> tuple[list[bytes], bytes]:
    """All that arrived as one message."""
    return [data], b""


# Of each port: messages of the client, messages of the server.
SPLITTERS: dict[str, tuple[SplitMessages, SplitMessages]] = {
    "control": (split_commands, split_lines),
    "image": (split_nothing, split_frames),
    "stream": (split_nothing, split_nothing),
}


@contextmanager
def run_mutation_proxy(
    port: str, server: Address, connect: Callable[[], ConnectionMutation]
) -> Iterator[Address]:
    """Address of a proxy in front of a server, for the length of a block.

    Args:
        port: `control`, `image` or `stream`: how messages are split.
        server: Address of the server.
        connect: Mutation of a new connection.
    """

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            client: socket.socket = self.request
            # A server that is gone is for the suite to notice: its connection ends at once.
            with suppress(OSError), socket.create_connection(server) as upstream:
                _relay(client, upstream, port, connect())

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as proxy:
        # A connection that a test left open must not delay the end of the block.
        proxy.daemon_threads, proxy.block_on_close = True, False
        thread = threading.Thread(target=proxy.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield "127.0.0.1", proxy.server_address[1]
        finally:
            proxy.shutdown()
            thread.join()


class _Direction:
    """One way of a connection: the bytes that do not make a whole message yet."""

    def __init__(
        self,
        source: socket.socket,
        sink: socket.socket,
        split: SplitMessages,
        mutate: MutateBytes,
        separator: bytes = b"",
    ) -> None:
        self._source, self._sink = source, sink
        self._split, self._mutate = split, mutate
        self._separator = separator
        self._rest = b""

    def forward(self) -> bool:
        """Pass on what has arrived; False at the end of the connection."""
        data = self._source.recv(_READ_BYTES)
        messages, self._rest = self._split(self._rest + data)
        for message in messages:
            self._send(self._mutate(message))
        return bool(data)

    def _send(self, message: bytes) -> None:
        end = message.rfind(self._separator) if self._separator else len(message)
        # Without Nagle's algorithm each call is a segment.
        for segment in (message[:end], message[end:]):
            if segment:
                self._sink.sendall(segment)


def _relay(
    client: socket.socket, upstream: socket.socket, port: str, mutation: ConnectionMutation
) -> None:
    for end in (client, upstream):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    split_requests, split_replies = SPLITTERS[port]
    directions = {
        client: _Direction(client, upstream, split_requests, mutation.mutate_request),
        upstream: _Direction(
            upstream,
            client,
            split_replies,
            mutation.mutate_reply,
            mutation.split_replies_before,
        ),
    }
    try:
        while all(directions[end].forward() for end in select.select(directions, [], [])[0]):
            pass
    except ConnectionError:
        for end in (client, upstream):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ZERO_LINGER)
