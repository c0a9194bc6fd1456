"""The ROUTER socket of the stream on the asyncio loop, and the queue of messages to one client.

The only module of the server with zmq. The socket never blocks and never queues without limit: a
message for a full peer is not sent and waits in the peer's `Outbox`, and messages from a fast peer
wait in the TCP connection of that peer. The guard owns the public port, with the ROUTER behind it
on a socket in a private folder. A lock file inside is locked while the server lives: the system
releases the lock with the process, however that ends, so that folders of killed servers are found.
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import logging
import os
import shutil
import socket
import stat
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from enum import Enum, auto
from pathlib import Path

import zmq
from zmq.utils.monitor import parse_monitor_message

from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_server.frames.frame import Payload
from catoptra_server.serve.limits import MAX_UNSENT_BYTES, MAX_UNSENT_MESSAGES
from catoptra_server.serve.port import BACKLOG, ConnectionLimits
from catoptra_server.serve.stream.guard import ConnectionGuard, GuardedConnection

log = logging.getLogger(__name__)
_MessageHandler = Callable[[bytes, list[bytes]], None]
# Messages of one peer in the queue of ZeroMQ, besides the TCP connection; replies that find no room
# wait in the peer's outbox. No more than keeps the connection busy: each may be a frame of 50 MB.
_SEND_HIGH_WATER_MARK = 2
# Messages of one peer that wait for the server; the rest stays in TCP, which blocks the peer.
_RECEIVE_HIGH_WATER_MARK = 16
# Messages per turn of the loop, so that a busy peer does not starve the others.
_MAX_MESSAGES_PER_READ = 32
_MONITOR_ENDPOINT = "inproc://monitor"
_PREFIX = "catoptra-"
_LOCK_NAME = "lock"
_SOCKET_NAME = "stream"
# All that a server puts there; a folder with other contents is not ours.
_CONTENTS = {_LOCK_NAME, _SOCKET_NAME}


class SendResult(Enum):
    """Outcome of a send."""

    SENT = auto()
    QUEUE_FULL = auto()
    DISCONNECTED = auto()


class Outbox:
    """Bounded queue in front of `send`, with one frame at most."""

    def __init__(
        self,
        send: Callable[[list[Payload]], SendResult],
        *,
        on_blocked: Callable[[], object],
        on_overflow: Callable[[], object],
    ) -> None:
        """Create an empty queue.

        Args:
            send: Sends a message at once or not at all.
            on_blocked: Called when the first message begins to wait; `flush` is to be called
                again and again from then on, until `is_blocked` is False.
            on_overflow: Called when the client reads too little, and the queue exceeds the bounds.
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
        """Send a message; False if the message has to wait."""
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
        if len(self._waiting) > MAX_UNSENT_MESSAGES or self._num_bytes > MAX_UNSENT_BYTES:
            self._on_overflow()
        return False


class RouterSocket:
    """A bound ROUTER behind a connection guard."""

    def __init__(
        self,
        listener: socket.socket,
        *,
        limits: ConnectionLimits,
        on_message: _MessageHandler,
        on_disconnect: Callable[[bytes], None],
    ) -> None:
        """Accept connections.

        Args:
            listener: Listening socket of the public port; closed with this one.
            limits: Limits of the connections.
            on_message: Called with the identity of a peer and the parts of a message.
            on_disconnect: Called with the identity of a peer whose connection has ended, before
                any message of another connection with the same identity.

        Raises:
            OSError: The private socket of the ROUTER is not available.
        """
        self._loop = asyncio.get_running_loop()
        self._on_message = on_message
        self._on_disconnect = on_disconnect
        with ExitStack() as resources:
            resources.enter_context(listener)
            self.port: int = listener.getsockname()[1]
            path = str(resources.enter_context(create_private_folder()) / _SOCKET_NAME)
            context = zmq.Context(io_threads=1)
            resources.callback(context.destroy, linger=0)
            self._monitor = context.socket(zmq.PAIR)
            self._socket = _bind_router(context, f"ipc://{path}", monitor=self._monitor)
            self._guard = ConnectionGuard(listener, path, limits=limits)
            resources.callback(self._guard.close)
            self._release = resources.pop_all().close
        # File descriptors of the connections: open ones, and the ones of peers with a message.
        self._open_connections: set[int] = set()
        self._connections: dict[bytes, int] = {}
        self._guarded: dict[bytes, GuardedConnection | None] = {}
        self._identities: dict[int, bytes] = {}
        self._is_closed = False
        self._scheduled_read: asyncio.Handle | None = None
        self._loop.add_reader(self._socket.FD, self._read)
        self._loop.add_reader(self._monitor.FD, self._read_monitor)
        self._schedule_read()

    def send(self, peer: bytes, parts: Sequence[Payload]) -> SendResult:
        """Send a message at once, or not at all; a closed socket has no connected peers."""
        if self._is_closed:
            return SendResult.DISCONNECTED
        connection = self._guarded.get(peer)
        if len(parts) > 1 and connection is not None:  # a frame
            if connection.is_closed:
                return SendResult.DISCONNECTED
            return SendResult.SENT if connection.send(parts) else SendResult.QUEUE_FULL
        result = self._try_send(peer, parts)
        if result is SendResult.QUEUE_FULL:
            # ZeroMQ notices only now and then that peers have read, except on this query.
            self._socket.get(zmq.EVENTS)
            result = self._try_send(peer, parts)
        # The file descriptor signals once, and either call may consume the signal of a message.
        self._schedule_read()
        return result

    def _try_send(self, peer: bytes, parts: Sequence[bytes | memoryview]) -> SendResult:
        try:
            self._socket.send_multipart([peer, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            return SendResult.QUEUE_FULL
        except zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
            self._forget(peer)
            return SendResult.DISCONNECTED
        return SendResult.SENT

    def find_connection(self, peer: bytes) -> GuardedConnection | None:
        """Connection of a peer to the public port; None once it has ended."""
        return self._guarded.get(peer)

    def disconnect(self, peer: bytes) -> None:
        """End the connection of a peer; unsent messages are dropped."""
        connection = self._connections.get(peer)
        if connection is None or self._is_closed:
            return
        # ZeroMQ has no call for this, so the connection is shut down below it. The descriptor is
        # duplicated first: if it is not reported as ended after that, it was the peer's until then,
        # and the duplicate stays so.
        with ExitStack() as stack, suppress(OSError):
            end = stack.enter_context(socket.socket(fileno=os.dup(connection)))
            self._read_monitor()
            if self._connections.get(peer) == connection:
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Release the port and drop all unsent messages."""
        self._is_closed = True
        self._loop.remove_reader(self._socket.FD)
        self._loop.remove_reader(self._monitor.FD)
        if self._scheduled_read is not None:
            self._scheduled_read.cancel()
        self._release()

    def _schedule_read(self) -> None:
        if self._scheduled_read is None:
            self._scheduled_read = self._loop.call_soon(self._run_scheduled_read)

    def _run_scheduled_read(self) -> None:
        self._scheduled_read = None
        self._read()

    def _read(self) -> None:
        for _ in range(_MAX_MESSAGES_PER_READ):
            try:
                # Without copies: only zmq's own message objects know the descriptor of their
                # connection.
                head, *parts = self._socket.recv_multipart(flags=zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            # Ends that were reported before this message are known before the message is handled: a
            # newcomer must not pass for the departed peer with the same identity or descriptor.
            self._read_monitor()
            if self._register(head.bytes, int(head.get(zmq.SRCFD))):
                self._on_message(head.bytes, [part.bytes for part in parts])
        self._schedule_read()

    def _register(self, peer: bytes, connection: int) -> bool:
        """Record the connection of a peer; False for one that has ended, whose rest is dropped."""
        if connection not in self._open_connections:
            return False
        if self._connections.get(peer, connection) != connection:
            self._end(peer)
        if peer not in self._connections:
            self._connections[peer] = connection
            self._identities[connection] = peer
            with ExitStack() as stack, suppress(OSError):
                end = stack.enter_context(socket.socket(fileno=os.dup(connection)))
                self._guarded[peer] = self._guard.find_connection(end)
        return True

    def _read_monitor(self) -> None:
        """Read the beginnings and ends of connections, all that are reported."""
        while True:
            try:
                event = parse_monitor_message(self._monitor.recv_multipart(flags=zmq.NOBLOCK))
            except zmq.Again:
                return
            connection = event["value"]
            if event["event"] == zmq.EVENT_ACCEPTED:
                self._open_connections.add(connection)
                continue
            self._open_connections.discard(connection)
            peer = self._identities.get(connection)
            if peer is not None:
                self._end(peer)

    def _end(self, peer: bytes) -> None:
        self._forget(peer)
        self._on_disconnect(peer)

    def _forget(self, peer: bytes) -> None:
        connection = self._connections.pop(peer, None)
        self._guarded.pop(peer, None)
        if connection is not None:
            self._identities.pop(connection, None)


def _bind_router(
    context: zmq.Context[zmq.Socket[bytes]], endpoint: str, *, monitor: zmq.Socket[bytes]
) -> zmq.Socket[bytes]:
    """Bind a ROUTER, with limits and a monitor of disconnections.

    Args:
        context: ZeroMQ context.
        endpoint: Private endpoint.
        monitor: PAIR socket that receives an event for every connection that begins or ends.

    Raises:
        OSError: The endpoint is not available.
    """
    router = context.socket(zmq.ROUTER)
    # All options before bind: later ones do not apply to connections of the endpoint.
    router.set(zmq.BACKLOG, BACKLOG)
    router.set(zmq.SNDHWM, _SEND_HIGH_WATER_MARK)
    router.set(zmq.RCVHWM, _RECEIVE_HIGH_WATER_MARK)
    # A longer part ends the connection as soon as the length is read, before memory is
    # allocated.
    router.set(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
    # A send to a disconnected or full peer fails, in place of a silent drop.
    router.set(zmq.ROUTER_MANDATORY, 1)
    # No HEARTBEAT_IVL: libzmq 4.3.5 aborts the process if its timer meets a connection that ended
    # while its queue was full. The guard's TCP options detect hosts that vanish.
    router.set(zmq.LINGER, 0)
    router.monitor(_MONITOR_ENDPOINT, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
    # Without a limit: ZeroMQ's thread must never wait for the loop to read the monitor.
    monitor.set(zmq.RCVHWM, 0)
    monitor.connect(_MONITOR_ENDPOINT)
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        reason = f"{endpoint}: {error.strerror}: set TMPDIR to a short, writable path"
        raise OSError(error.errno, reason) from error
    return router


@contextmanager
def create_private_folder() -> Iterator[Path]:
    """A new folder that only this user can open, until the block ends; sweeps old ones before.

    Raises:
        OSError: The folder for temporary files is not writable.
    """
    _remove_abandoned_folders(Path(tempfile.gettempdir()))
    # mkdtemp sets mode 0700: no other user can bypass the guard.
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    try:
        with _create_lock(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _create_lock(folder: Path) -> Iterator[None]:
    # Locked before the file has its name: another server that starts now sees no lock that is free.
    unnamed = folder / (_LOCK_NAME + ".new")
    with unnamed.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        unnamed.rename(folder / _LOCK_NAME)
        yield


def _remove_abandoned_folders(parent: Path) -> None:
    """Remove the folders of servers that were killed."""
    try:
        candidates = list(parent.glob(_PREFIX + "*"))
    except OSError:
        return
    for folder in candidates:
        # Another server may remove the same folder at the same time.
        with suppress(OSError):
            if _is_own_folder(folder) and _has_no_server(folder):
                shutil.rmtree(folder)
                log.info("removed %s, which a killed server left", folder)


def _is_own_folder(folder: Path) -> bool:
    """Whether a folder is one that a server of this user made, without following links."""
    status = folder.lstat()
    return (
        stat.S_ISDIR(status.st_mode)
        and status.st_uid == os.getuid()
        and stat.S_IMODE(status.st_mode) == 0o700
        and {entry.name for entry in folder.iterdir()} <= _CONTENTS
    )


def _has_no_server(folder: Path) -> bool:
    """Whether no living server holds the lock of a folder; False for one without a lock yet."""
    try:
        lock = os.open(folder / _LOCK_NAME, os.O_RDONLY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(lock)
    return True
