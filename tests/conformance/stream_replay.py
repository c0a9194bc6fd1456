"""One run of a check on the stream, recorded, and replayed with another content of its replies.

A check talks to the socket of a StreamClient; one that replays answers each request as the server
did, at the times of the recording. So a mutant costs a check's computation, not its waiting.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import msgpack

from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from conformance.check import Check, ServerUnderTest
from conformance.page_session import on_page
from conformance.suite import RowResult, play_check

Fields = dict[str, Any]  # Any: every value of msgpack

# A check that waits for a state that never comes asks this often.
_REPEAT_S = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Exchange:
    """One request and its reply."""

    connection: int
    """Number of the check's connection."""
    request: Fields
    sent_s: float
    received_s: float
    reply: Fields
    parts: list[bytes]
    """Image and labels."""


@dataclass(slots=True)
class Recorder:
    """Sockets of a check, and what they exchange."""

    clock: Callable[[], float]
    exchanges: list[Exchange] = field(default_factory=list)
    num_connections: int = 0

    def replace_socket(self, socket: StreamSocket) -> StreamSocket:
        """Socket that passes everything on and keeps it."""
        self.num_connections += 1
        return cast(StreamSocket, _RecordingSocket(self, socket, self.num_connections))


class _RecordingSocket:
    def __init__(self, recorder: Recorder, socket: StreamSocket, number: int) -> None:
        self._recorder, self._socket, self._number = recorder, socket, number
        self.address, self.begin_wait = socket.address, socket.begin_wait
        self.check_alive, self.close = socket.check_alive, socket.close
        self._pending: dict[int, tuple[Fields, float]] = {}

    def send(self, data: bytes, deadline_s: float) -> None:
        request = msgpack.unpackb(data)
        self._pending[request["id"]] = request, self._recorder.clock()
        self._socket.send(data, deadline_s)

    def receive(self, deadline_s: float) -> list[bytes] | None:
        parts = self._socket.receive(deadline_s)
        if parts is not None and (reply := msgpack.unpackb(parts[0])).get("id") in self._pending:
            request, sent_s = self._pending.pop(reply["id"])
            times = sent_s, self._recorder.clock()
            self._recorder.exchanges.append(
                Exchange(self._number, request, *times, reply, parts[1:])
            )
        return parts


def record_check(check: Check, server: ServerUnderTest) -> tuple[RowResult, list[Exchange]]:
    """Result of a check, and what it exchanged; without the server's other ports."""
    recorder = Recorder(server.clock)
    wrap = (on_page(server) if check.port == "page" else server).replace_socket

    def replace_socket(socket: StreamSocket) -> StreamSocket:
        return recorder.replace_socket(socket if wrap is None else wrap(socket))

    addresses = {check.port: server.addresses[check.port]}
    recorded = replace(server, addresses=addresses, replace_socket=replace_socket)
    return play_check(check, recorded), recorder.exchanges


def replay_check(check: Check, server: ServerUnderTest, exchanges: Sequence[Exchange]) -> RowResult:
    """Result of a check against a recording."""
    replay = _Replay(exchanges)
    replayed = replace(
        server,
        addresses={check.port: ("127.0.0.1", 1)},
        clock=lambda: replay.now_s,
        replace_socket=replay.replace_socket,
    )
    return play_check(check, replayed)


class _Replay:
    """Time and connections of a replay."""

    def __init__(self, exchanges: Sequence[Exchange]) -> None:
        self.now_s = exchanges[0].sent_s if exchanges else 0.0
        self._connections: dict[int, list[Exchange]] = defaultdict(list)
        for one in exchanges:
            self._connections[one.connection].append(one)
        self._num_connections = 0

    def replace_socket(self, socket: StreamSocket) -> StreamSocket:
        socket.close()
        self._num_connections += 1
        exchanges = self._connections[self._num_connections]
        return cast(StreamSocket, _ReplayingSocket(self, exchanges))


class _ReplayingSocket:
    """Answers each request by the next reply to the same one, or else by the last one."""

    address = "recording"

    def __init__(self, replay: _Replay, exchanges: list[Exchange]) -> None:
        self._replay = replay
        self._queues: dict[str, list[Exchange]] = defaultdict(list)
        for one in exchanges:
            self._queues[_key(one.request)].append(one)
        self._pending: list[bytes] | None = None

    def begin_wait(self) -> None:
        pass

    def check_alive(self) -> None:
        pass

    def close(self) -> None:
        pass

    def send(self, data: bytes, deadline_s: float) -> None:
        request = msgpack.unpackb(data)
        queue = self._queues[_key(request)]
        replay = self._replay
        if not queue:
            replay.now_s = deadline_s
            return
        one = queue.pop(0) if len(queue) > 1 else queue[0]
        # A repeated reply is from the past.
        replay.now_s = max(replay.now_s + (one.sent_s < replay.now_s) * _REPEAT_S, one.received_s)
        id_ = one.reply["id"] - one.request["id"] + request["id"]
        self._pending = [msgpack.packb({**one.reply, "id": id_}), *one.parts]

    def receive(self, deadline_s: float) -> list[bytes] | None:
        parts, self._pending = self._pending, None
        if parts is None:
            self._replay.now_s = max(self._replay.now_s, deadline_s)
        return parts


def _key(request: Fields) -> str:
    return repr(sorted((key, value) for key, value in request.items() if key != "id"))
