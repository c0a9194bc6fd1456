"""Defence against a ZeroMQ message that never ends: a monitor of byte counters, or the guard.

Run: .venv/bin/python tests/measurements/unterminated_messages.py. Linux only, for TCP_INFO.

Three servers reply with raw frames of 640 x 640: a bare ROUTER; one with a monitor that every 20 or
50 ms closes the connections that sent more than 1 MiB (a best case: delivered bytes are not
subtracted); and the server's own RouterSocket behind its connection guard. Prints the cost of a
frame, in turns and as medians; then the growth of memory under four attackers at full speed that
reconnect when disconnected (the bare ROUTER is attacked for half a second only), and the frames
that a client at 40 frames/s still receives. Decision: the connection guard
(serve/stream/guard.py).
"""

from __future__ import annotations

import asyncio
import os
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import zmq
from zmq.utils.monitor import parse_monitor_message

sys.path.insert(0, str(Path(__file__).parents[1]))

from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.stream.router import RouterSocket
from helpers.zmtp import LONG, MORE, connect_with_handshake, zmtp_frame

HOST = "127.0.0.1"
FRAME = [bytes(900), os.urandom(640 * 640 * 3)]
FRAME_PERIOD_S = 0.025
BLOCKS = {
    "empty": zmtp_frame(b"", MORE) * 100_000,
    "8 KiB": zmtp_frame(bytes(8192), LONG | MORE) * 32,
}
ATTACKERS = 4
ATTACK_S = {"bare": 0.5, "monitor 20": 5.0, "monitor 50": 5.0, "guard": 5.0}
MAX_OUTSTANDING_BYTES = 2**20
BYTES_RECEIVED_OFFSET = 128  # tcpi_bytes_received in linux/tcp.h


def main() -> None:
    """Measure the cost of a frame and the growth under attack, and print both."""
    print("cost of a frame: round trip, processor time of the server at 40/s")
    for _ in range(3):
        for kind in ("bare", "guard"):
            with run_server(kind) as (server, port), connect_client(port) as peer:
                trip_ms = 1e3 * statistics.median(measure_round_trips_s(peer, 300, 0.0))
                before_s = read_cpu_s(server)
                measure_round_trips_s(peer, 120, FRAME_PERIOD_S)
                cpu_ms = 1e3 * (read_cpu_s(server) - before_s) / 120
                print(f"  {kind:10s} {trip_ms:5.2f} ms   {cpu_ms:5.2f} ms")
    print(f"growth under {ATTACKERS} attackers; frames received by a client, longest round trip")
    for block in BLOCKS:
        for kind in ATTACK_S:
            attack(kind, block)


def attack(kind: str, block: str) -> None:
    """Attack a server; print the growth of memory and the frames of a client."""
    with run_server(kind) as (server, port), connect_client(port) as peer:
        measure_round_trips_s(peer, 40, FRAME_PERIOD_S)
        before_mb = read_memory_mb(server)
        expected = round(ATTACK_S[kind] / FRAME_PERIOD_S)
        arguments = ["attack", str(port), block, str(ATTACK_S[kind])]
        attackers = [subprocess.Popen([sys.executable, __file__, *arguments])
                     for _ in range(ATTACKERS)]  # fmt: skip
        trips_s, peak_mb, end_s = [], 0.0, time.monotonic() + ATTACK_S[kind]
        while time.monotonic() < end_s:
            trips_s += measure_round_trips_s(peer, 1, FRAME_PERIOD_S)
            peak_mb = max(peak_mb, read_memory_mb(server) - before_mb)
        for attacker in attackers:
            attacker.kill()
            attacker.wait()
        print(f"  {kind:10s} {block:6s} {peak_mb:6.0f} MB   {len(trips_s):3d} of {expected:3d}, "
              f"{1e3 * max(trips_s):4.0f} ms")  # fmt: skip


@contextmanager
def run_server(kind: str) -> Iterator[tuple[int, int]]:
    """Run a server in a process of its own; yield process and port."""
    command = [sys.executable, __file__, "serve", kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.pid, int(process.stdout.readline())
        process.kill()


@contextmanager
def connect_client(port: int) -> Iterator[zmq.Socket[bytes]]:
    """Connect a DEALER socket."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as peer:
        peer.set(zmq.LINGER, 0)
        peer.connect(f"tcp://{HOST}:{port}")
        yield peer


def measure_round_trips_s(peer: zmq.Socket[bytes], count: int, period_s: float) -> list[float]:
    """Round-trip times of a number of requests, one per period."""
    trips_s = []
    for _ in range(count):
        begin = time.perf_counter()
        peer.send(b"request")
        peer.recv_multipart()
        trips_s.append(time.perf_counter() - begin)
        time.sleep(max(0.0, period_s - trips_s[-1]))
    return trips_s


def read_cpu_s(process: int) -> float:
    """Processor time of a process."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def read_memory_mb(process: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def send_unterminated_message(port: int, block: bytes, end_s: float) -> None:
    """Send parts of a message without end; reconnect when disconnected."""
    while time.monotonic() < end_s:
        with suppress(OSError, AssertionError), connect_with_handshake(port) as peer:
            peer.settimeout(1.0)
            while time.monotonic() < end_s:
                peer.send(block)


async def serve_behind_guard() -> None:
    """Reply to every request with a frame, through the guard; print the port."""
    router = RouterSocket(
        HOST,
        0,
        limits=ConnectionLimits(),
        on_message=lambda peer_id, _: router.send(peer_id, FRAME),
        on_disconnect=lambda _: None,
    )
    print(router.port, flush=True)
    await asyncio.Event().wait()


def serve_bare(monitor_interval_s: float) -> None:
    """The same without a guard, with a monitor at an interval; 0 = without a monitor."""
    bare = zmq.Context().socket(zmq.ROUTER)
    bare.bind(f"tcp://{HOST}:*")
    events = bare.get_monitor_socket(zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
    print(bare.get_string(zmq.LAST_ENDPOINT).rpartition(":")[2], flush=True)
    connections: dict[int, socket.socket] = {}
    next_check_s = time.monotonic()
    while True:
        bare.poll(1000 * (monitor_interval_s or 1.0))
        answer_requests(bare)
        if monitor_interval_s and time.monotonic() >= next_check_s:
            track_connections(events, connections)
            disconnect_senders(connections)
            next_check_s = time.monotonic() + monitor_interval_s


def answer_requests(bare: zmq.Socket[bytes]) -> None:
    """Reply to all requests that have arrived."""
    with suppress(zmq.Again):
        while True:
            peer_id, *_ = bare.recv_multipart(zmq.NOBLOCK)
            bare.send_multipart([peer_id, *FRAME], zmq.NOBLOCK)


def track_connections(events: zmq.Socket[bytes], connections: dict[int, socket.socket]) -> None:
    """Keep a second descriptor of every accepted connection."""
    with suppress(zmq.Again):
        while True:
            event = parse_monitor_message(events.recv_multipart(zmq.NOBLOCK))
            closed = connections.pop(event["value"], None)
            if closed is not None:
                closed.close()
            with suppress(OSError):  # already closed by the peer
                if event["event"] == zmq.EVENT_ACCEPTED:
                    connections[event["value"]] = socket.socket(fileno=os.dup(event["value"]))


def disconnect_senders(connections: dict[int, socket.socket]) -> None:
    """Close the connections that sent more than the limit."""
    for number, end in list(connections.items()):
        with suppress(OSError):
            info = end.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
            if struct.unpack_from("Q", info, BYTES_RECEIVED_OFFSET)[0] > MAX_OUTSTANDING_BYTES:
                del connections[number]
                with end:
                    end.shutdown(socket.SHUT_RDWR)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["serve", "guard"]:
            asyncio.run(serve_behind_guard())
        case ["serve", kind]:
            serve_bare(int(kind.partition(" ")[2] or 0) / 1e3)
        case ["attack", port, block, duration_s]:
            send_unterminated_message(
                int(port), BLOCKS[block], time.monotonic() + float(duration_s)
            )
        case _:
            main()
