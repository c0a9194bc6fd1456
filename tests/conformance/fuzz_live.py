"""Does a live server stand what strangers send, and do the others notice? Garbage on all ports.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_live --seconds 30 --seed 1`. Starts a
server; strangers throw random and mutated bytes at its three ports, whole messages at the stream
too, and come again when they are cut off. Meanwhile one client has a robot, looks at it over both
transports, and must not notice. Prints a table; exits with 0 if every requirement holds.
Messages of endless parts are left out: that limit of the stream is known (SPEC.md 9.7).
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from conformance.fuzz_peers import Guest, Strangers, Tally
from helpers.memory import resident_mb
from helpers.server_process import RunningServer, running_server
from helpers.verdicts import Verdict, print_verdicts

PERIOD_S = 0.2
# Of 0.2 s: the mean keeps to it within so much, and 19 of 20 single ones.
TOLERANCE = 0.2
# What the strangers' connections, buffers and the allocator's pools may take, whatever they send.
GROWTH_MB = 64.0
_SAMPLE_EVERY_S = 0.5
_BEFORE_STRANGERS_S = 2.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz a server and judge it; return the exit status."""
    options = argparse.ArgumentParser(description="Throw garbage at a live server.")
    options.add_argument("--seconds", type=float, default=30.0)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        verdicts = fuzz_live(Path(folder), seconds=given.seconds, seed=given.seed)
    return print_verdicts(verdicts)


def fuzz_live(folder: Path, *, seconds: float, seed: int) -> list[Verdict]:
    """Start a server, fuzz it for so long, and judge what became of it and of its guest."""
    with running_server(folder, "--image-type", "GOOD", within_s=seconds + 60.0) as server:
        guest = Guest(server)
        strangers = Strangers(server, seed)
        memory_mb = asyncio.run(_play(server, guest, strangers, seconds))
        lives, faults = server.process.poll() is None, _faults(server)
        status = server.end() if lives else server.process.returncode
        late_faults = _faults(server) - faults
    return [
        Verdict(
            "the server lives, and nothing unforeseen is in its log",
            f"{'alive' if lives else 'dead'}, {faults} tracebacks",
            lives and not faults,
        ),
        Verdict(
            "the strangers were heard",
            f"{strangers.connections} connections, {strangers.sent_bytes / 1e6:.1f} MB sent",
            strangers.connections >= 10 and strangers.sent_bytes > 100_000,
        ),
        judged_memory(memory_mb),
        *judged_guest(guest.saw),
        Verdict(
            "told to end when they have left, it ends, and says nothing unforeseen",
            f"exit status {status}, {late_faults} tracebacks",
            status == 0 and not late_faults,
        ),
    ]


def _faults(server: RunningServer) -> int:
    return server.log.read_text(errors="replace").count("Traceback")


async def _play(
    server: RunningServer, guest: Guest, strangers: Strangers, seconds: float
) -> list[float]:
    """Let the guest settle, then the strangers in; return the server's memory over time."""
    tasks = [asyncio.create_task(play) for play in guest.plays()]
    await asyncio.sleep(_BEFORE_STRANGERS_S)
    memory_mb = [resident_mb(server.process.pid)]
    rude = [asyncio.create_task(play) for play in strangers.plays()]
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and server.process.poll() is None:
        await asyncio.sleep(_SAMPLE_EVERY_S)
        if server.process.poll() is None:
            memory_mb.append(resident_mb(server.process.pid))
    for task in (*tasks, *rude):
        if task.done() and not task.cancelled():
            guest.saw.faults.append(f"ended early: {task.exception()!r}")
    await _ended((*tasks, *rude))
    guest.close()
    strangers.close()
    return memory_mb


async def _ended(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel tasks until they have ended.

    Once is not enough: Python 3.11's `asyncio.wait_for` forgets that it was cancelled if what it
    waits for is done at the same moment, and these tasks would play for ever.
    """
    while pending := [task for task in tasks if not task.done()]:
        for task in pending:
            task.cancel()
        await asyncio.wait(pending, timeout=PERIOD_S)
    await asyncio.gather(*tasks, return_exceptions=True)


def judged_memory(memory_mb: list[float]) -> Verdict:
    """Judge sizes over time; the first is of before the strangers came."""
    growth_mb = max(memory_mb) - memory_mb[0]
    return Verdict(
        f"the server's memory grows by at most {GROWTH_MB:.0f} MB",
        f"{memory_mb[0]:.0f} MB before, {max(memory_mb):.0f} MB at most, {memory_mb[-1]:.0f} at "
        "the end",
        growth_mb <= GROWTH_MB,
    )


def judged_guest(guest: Tally) -> list[Verdict]:
    """Judge what a guest saw: its cycle, and its frames."""
    periods = [later - earlier for earlier, later in pairwise(guest.status_s)]
    mean_s = statistics.fmean(periods) if periods else float("inf")
    late = sum(p > (1.0 + TOLERANCE) * PERIOD_S for p in periods) / max(1, len(periods))
    return [
        Verdict(
            "a client that behaves keeps its 0.2 s cycle: the mean within 20 %, 19 of 20 too",
            f"mean {mean_s:.3f} s of {len(periods)}, {late:.1%} are longer than 0.24 s",
            abs(mean_s - PERIOD_S) <= TOLERANCE * PERIOD_S and late <= 0.05,
        ),
        Verdict(
            "its frames come whole and in order on both transports, its answers to it alone",
            f"{guest.tcp_frames} over TCP, {guest.stream_frames} over the stream, "
            f"{len(guest.faults)} faults {guest.faults[:2]}",
            min(guest.tcp_frames, guest.stream_frames) >= 10 and not guest.faults,
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
