"""The ROUTER socket, its private folder, and messages that wait for room."""

from __future__ import annotations

import asyncio
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from catoptra_server.serve.port import ConnectionLimits, create_listener
from catoptra_server.serve.stream.router import (
    Outbox,
    RouterSocket,
    SendResult,
    create_private_folder,
)
from helpers.loopback import HOST, wait_until
from helpers.stream_peer import connect_raw_peer
from helpers.zmtp import LONG, MORE, connect_with_handshake, send_until_disconnect, zmtp_frame


@dataclass
class Queue:
    """A queue with room for some messages, and a record of the outbox's calls."""

    room: int
    sent: list[list[bytes]] = field(default_factory=list)
    num_blocked: int = 0
    num_overflows: int = 0

    def send(self, parts: list[bytes]) -> SendResult:
        """Accept a message if there is room."""
        if not self.room:
            return SendResult.QUEUE_FULL
        self.room -= 1
        self.sent.append(parts)
        return SendResult.SENT

    def block(self) -> None:
        """Count a call."""
        self.num_blocked += 1

    def overflow(self) -> None:
        """Count a call."""
        self.num_overflows += 1


def open_outbox(queue: Queue) -> Outbox:
    return Outbox(queue.send, on_blocked=queue.block, on_overflow=queue.overflow)


def test_messages_when_there_is_no_room_wait_and_keep_their_order() -> None:
    queue = Queue(room=1)
    outbox = open_outbox(queue)
    for number in range(4):
        outbox.send(b"%d" % number)
    assert (queue.sent, outbox.is_blocked, queue.num_blocked) == ([[b"0"]], True, 1)
    queue.room = 2
    assert outbox.flush()
    assert (len(queue.sent), outbox.is_blocked) == (3, True)
    queue.room = 9
    outbox.send(b"4")
    assert [parts[0] for parts in queue.sent] == [b"%d" % number for number in range(5)]
    assert not outbox.is_blocked
    assert not outbox.flush()


def test_frame_when_it_waits_is_withdrawn_and_its_neighbours_stay() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send(b"before")
    outbox.send_frame(b"header", b"image")
    outbox.send(b"after")
    assert outbox.withdraw_frame()
    assert not outbox.withdraw_frame()
    queue.room = 9
    outbox.flush()
    assert queue.sent == [[b"before"], [b"after"]]


def test_frame_when_sent_is_not_withdrawn() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send_frame(b"header", b"image")
    queue.room = 2
    outbox.flush()
    assert not outbox.withdraw_frame()
    outbox.send_frame(b"header 2", b"image")
    assert not outbox.withdraw_frame()
    assert queue.sent == [[b"header", b"image"], [b"header 2", b"image"]]


def test_messages_when_too_many_wait_are_an_overflow() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    for _ in range(128):
        outbox.send(b"")
    assert queue.num_overflows == 0
    outbox.send(b"")
    assert queue.num_overflows == 1


def test_messages_when_too_long_are_an_overflow_and_a_frame_is_not() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send_frame(b"header", bytes(8 * 1024 * 1024))
    outbox.send(bytes(4 * 1024 * 1024))
    assert queue.num_overflows == 0
    outbox.send(b"1")
    assert queue.num_overflows == 1


def test_bytes_when_sent_count_no_longer() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    for _ in range(20):
        outbox.send(bytes(1024 * 1024))
        queue.room = 1
        outbox.flush()
    assert (queue.num_overflows, len(queue.sent)) == (0, 20)


def test_messages_when_closed_are_dropped() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send(b"early")
    outbox.close()
    queue.room = 9
    outbox.send(b"late")
    outbox.flush()
    assert (queue.sent, outbox.is_blocked) == ([], False)


# Prints the folder and waits, as a server does; a socket file stays behind when it is killed.
OTHER_SERVER = """
import signal
from catoptra_server.serve.stream.router import create_private_folder
with create_private_folder() as folder:
    (folder / "stream").touch()
    print(folder, flush=True)
    signal.pause()
"""


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Folder for temporary files of this process and of its children."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def start_other_server() -> tuple[subprocess.Popen[str], Path]:
    process = subprocess.Popen(
        [sys.executable, "-c", OTHER_SERVER], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def test_folder_is_of_this_user_alone_and_removed_at_the_end(temporary_folder: Path) -> None:
    with create_private_folder() as folder:
        assert folder.parent == temporary_folder
        assert folder.stat().st_mode & 0o077 == 0
        (folder / "stream").touch()
    assert list(temporary_folder.iterdir()) == []


def test_folder_of_a_killed_server_is_removed_and_of_a_living_one_stays() -> None:
    killed, killed_folder = start_other_server()
    living, living_folder = start_other_server()
    with killed, living:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert killed_folder.exists()
        with create_private_folder() as own, create_private_folder() as second:
            assert own.exists()
            assert second.exists()
            assert living_folder.exists()
            assert not killed_folder.exists()
        living.kill()


def test_folders_that_no_server_made_stay(temporary_folder: Path) -> None:
    def make(name: str, *files: str, mode: int = 0o700) -> Path:
        folder = temporary_folder / name
        folder.mkdir(mode=mode)
        for file in files:
            (folder / file).touch()
        return folder

    others = [
        make("catoptra-cache", "lock", "results.json"),
        make("catoptra-shared", "lock", mode=0o755),
        make("catoptra-starting"),  # of a server that has no lock yet
        make("other-server", "lock", "stream"),
    ]
    (temporary_folder / "catoptra-file").touch()
    link = temporary_folder / "catoptra-link"
    link.symlink_to(make("target", "lock"))
    with create_private_folder():
        pass
    assert all(folder.exists() for folder in (*others, link, temporary_folder / "target/lock"))
    assert (temporary_folder / "catoptra-file").exists()
    # The form of a folder that is swept, so that the others stay for the reasons above.
    swept = make("catoptra-swept", "lock", "stream")
    with create_private_folder():
        assert not swept.exists()


# More than the kernel buffers for a connection without a reader: a few megabytes.
UNTERMINATED_BYTES = 32_000_000
UNTERMINATED = {
    "small parts": zmtp_frame(bytes(30), MORE) * 3000,
    "largest parts": zmtp_frame(bytes(16 * 1024), LONG | MORE) * 10,
}


class RouterFixture:
    """A socket that records its messages."""

    def __init__(self, host: str = HOST) -> None:
        self.received: asyncio.Queue[tuple[bytes, list[bytes]]] = asyncio.Queue()
        self.ended: asyncio.Queue[bytes] = asyncio.Queue()
        self.socket = RouterSocket(
            create_listener(host, 0, name="stream"),
            limits=ConnectionLimits(),
            on_message=lambda peer, parts: self.received.put_nowait((peer, parts)),
            on_disconnect=self.ended.put_nowait,
        )

    def __enter__(self) -> RouterFixture:
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.close()


async def test_messages_when_many_arrive_at_once_are_all_received_in_order() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as peer:
        for number in range(100):
            await peer.send(b"%d" % number, b"more")
        got = [(await router.received.get())[1] for _ in range(100)]
        assert got == [[b"%d" % number, b"more"] for number in range(100)]


async def test_messages_when_the_peer_reads_at_once_are_all_sent() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as peer:
        for _ in range(2000):  # without the query of events one in hundreds fails
            await peer.send(b"ping")
            identity, _ = await router.received.get()
            assert router.socket.send(identity, [b"pong"]) is SendResult.SENT
            assert await peer.socket.recv_multipart() == [b"pong"]


async def test_message_when_sent_after_the_end_has_no_peer() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as peer:
        await peer.send(b"ping")
        identity, _ = await router.received.get()
    assert router.socket.send(identity, [b"late"]) is SendResult.DISCONNECTED


async def test_end_of_a_connection_is_reported_for_its_peer_alone() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as connected:
        await connected.send(b"ping")
        await router.received.get()
        with connect_raw_peer(router.socket.port) as leaving:
            await leaving.send(b"ping")
            identity, _ = await router.received.get()
        assert await router.ended.get() == identity
        # ZeroMQ's thread reports the end to the monitor before the socket learns of it.
        await wait_until(
            lambda: router.socket.send(identity, [b"?"]) is SendResult.DISCONNECTED,
            "a send that finds no peer",
        )
        await connected.send(b"ping")
        await router.received.get()
        assert router.ended.empty()


async def test_peers_with_the_same_identity_have_different_ones() -> None:
    with (
        RouterFixture() as router,
        connect_raw_peer(router.socket.port, identity=b"same") as one,
        connect_raw_peer(router.socket.port, identity=b"same") as other,
    ):
        identities = set()
        for peer in (one, other):
            await peer.send(b"ping")
            identity, _ = await router.received.get()
            identities.add(identity)
            assert router.socket.send(identity, [b"pong"]) is SendResult.SENT
            assert await peer.socket.recv_multipart() == [b"pong"]
        assert len(identities) == 2
        assert b"same" not in identities


async def test_peer_when_disconnected_is_closed_and_others_stay() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as other:
        with await asyncio.to_thread(connect_with_handshake, router.socket.port) as peer:
            peer.sendall(zmtp_frame(b"ping"))
            identity, _ = await router.received.get()
            router.socket.disconnect(identity)
            assert await router.ended.get() == identity
            assert await asyncio.to_thread(read_until_end, peer)
            router.socket.disconnect(identity)  # of no effect
        await other.send(b"ping")
        await router.received.get()
        assert router.ended.empty()


def read_until_end(peer: socket.socket) -> bool:
    """Read until the other side has closed."""
    while peer.recv(1024):
        pass
    return True


async def test_messages_when_the_peer_reads_nothing_fill_its_queue() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port, high_water_mark=1) as peer:
        await peer.send(b"here")
        identity, _ = await router.received.get()
        # Buffers of both sides take a part that depends on the system and on its load.
        results = (router.socket.send(identity, [bytes(1_000_000)]) for _ in range(1000))
        assert next(results) is SendResult.SENT
        assert SendResult.QUEUE_FULL in results


async def test_port_when_in_use_raises_os_error_with_its_number() -> None:
    with socket.create_server((HOST, 0)) as in_use:
        port = in_use.getsockname()[1]
        with pytest.raises(OSError, match=f"stream port 127.0.0.1:{port}: Address already"):
            create_listener(HOST, port, name="stream")


async def test_host_name_is_resolved() -> None:
    with RouterFixture("localhost") as router:
        assert router.socket.port > 0


@pytest.mark.parametrize("block", UNTERMINATED.values(), ids=UNTERMINATED)
async def test_peers_when_their_messages_never_end_are_disconnected_and_others_served(
    block: bytes,
) -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as peer:
        port = router.socket.port
        attacks = asyncio.gather(*(asyncio.to_thread(_attack, port, block) for _ in range(4)))
        served = 0
        while served < 50 or not attacks.done():
            await peer.send(b"ping")
            identity, parts = await router.received.get()
            assert parts == [b"ping"]
            assert router.socket.send(identity, [b"pong"]) is SendResult.SENT
            assert await peer.socket.recv_multipart() == [b"pong"]
            served += 1
        assert max(await attacks) < UNTERMINATED_BYTES


def _attack(port: int, block: bytes) -> int:
    """Send an endless message; the number of bytes until the connection ended."""
    return send_until_disconnect(port, block, max_bytes=UNTERMINATED_BYTES)


async def test_peers_when_they_disconnect_inside_a_message_do_not_affect_others() -> None:
    with RouterFixture() as router, connect_raw_peer(router.socket.port) as peer:
        for _ in range(10):
            with await asyncio.to_thread(connect_with_handshake, router.socket.port) as broken:
                broken.sendall(zmtp_frame(b"half", MORE))
        await peer.send(b"complete")
        _, parts = await router.received.get()
        assert parts == [b"complete"]


async def test_socket_when_closed_removes_its_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with RouterFixture():
        (folder,) = tmp_path.iterdir()
        assert folder.stat().st_mode & 0o077 == 0
    assert list(tmp_path.iterdir()) == []


async def test_socket_when_its_private_endpoint_fails_names_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("deep" * 30)  # longer than the address of a Unix socket may be
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    listener = create_listener(HOST, 0, name="stream")
    with pytest.raises(OSError, match="set TMPDIR to a short, writable path"):
        RouterSocket(listener, limits=ConnectionLimits(), on_message=print, on_disconnect=print)
    assert listener.fileno() == -1  # closed
    assert list(deep.iterdir()) == []
