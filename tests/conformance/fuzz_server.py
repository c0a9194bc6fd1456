"""Does a live server stand what strangers send, and do the others notice? Garbage on all ports.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_server --seconds 30 --seed 1`. Starts a
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

from conformance.fuzz_clients import MalformedClients, ReferenceClient, ReferenceClientLog
from helpers.memory import resident_mb
from helpers.requirement_results import RequirementResult, print_requirements
from helpers.server_process import RunningServer, start_server

REPORT_PERIOD_S = 0.2
# Of 0.2 s: the mean keeps to it within so much, and 19 of 20 single ones.
PERIOD_TOLERANCE = 0.2
# What the strangers' connections, buffers and the allocator's pools may take, whatever they send.
MAX_GROWTH_MB = 64.0
_MEMORY_SAMPLE_PERIOD_S = 0.5
_WARM_UP_S = 2.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz a server and judge it; return the exit status."""
    options = argparse.ArgumentParser(description="Throw garbage at a live server.")
    options.add_argument("--seconds", type=float, default=30.0)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        verdicts = fuzz_server(Path(folder), seconds=given.seconds, seed=given.seed)
    return print_requirements(verdicts)


def fuzz_server(folder: Path, *, seconds: float, seed: int) -> list[RequirementResult]:
    """Start a server, fuzz it for so long, and judge what became of it and of its guest."""
    with start_server(folder, "--image-type", "GOOD") as server:
        guest = ReferenceClient(server)
        strangers = MalformedClients(server, seed)
        memory_mb = asyncio.run(_run_clients(server, guest, strangers, seconds))
        lives, faults = server.process.poll() is None, _count_tracebacks(server)
        status = server.terminate() if lives else server.process.returncode
        late_faults = _count_tracebacks(server) - faults
    return [
        RequirementResult(
            "the server lives, and nothing unforeseen is in its log",
            f"{'alive' if lives else 'dead'}, {faults} tracebacks",
            lives and not faults,
        ),
        RequirementResult(
            "the strangers were heard",
            f"{strangers.num_connections} connections, {strangers.sent_bytes / 1e6:.1f} MB sent",
            strangers.num_connections >= 10 and strangers.sent_bytes > 100_000,
        ),
        evaluate_memory(memory_mb),
        *evaluate_reference_client(guest.log),
        RequirementResult(
            "told to end when they have left, it ends, and says nothing unforeseen",
            f"exit status {status}, {late_faults} tracebacks",
            status == 0 and not late_faults,
        ),
    ]


def _count_tracebacks(server: RunningServer) -> int:
    return server.log.read_text(errors="replace").count("Traceback")


async def _run_clients(
    server: RunningServer,
    reference_client: ReferenceClient,
    malformed_clients: MalformedClients,
    seconds: float,
) -> list[float]:
    """Let the guest settle, then the strangers in; return the server's memory over time."""
    tasks = [asyncio.create_task(play) for play in reference_client.client_tasks()]
    await asyncio.sleep(_WARM_UP_S)
    memory_mb = [resident_mb(server.process.pid)]
    rude = [asyncio.create_task(play) for play in malformed_clients.client_tasks()]
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and server.process.poll() is None:
        await asyncio.sleep(_MEMORY_SAMPLE_PERIOD_S)
        if server.process.poll() is None:
            memory_mb.append(resident_mb(server.process.pid))
    for task in (*tasks, *rude):
        if task.done() and not task.cancelled():
            reference_client.log.faults.append(f"ended early: {task.exception()!r}")
    await _cancel_tasks((*tasks, *rude))
    reference_client.close()
    malformed_clients.close()
    return memory_mb


async def _cancel_tasks(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel tasks until they have ended.

    Once is not enough: Python 3.11's `asyncio.wait_for` forgets that it was cancelled if what it
    waits for is done at the same moment, and these tasks would play for ever.
    """
    while pending := [task for task in tasks if not task.done()]:
        for task in pending:
            task.cancel()
        await asyncio.wait(pending, timeout=REPORT_PERIOD_S)
    await asyncio.gather(*tasks, return_exceptions=True)


def evaluate_memory(memory_mb: list[float]) -> RequirementResult:
    """Judge sizes over time; the first is of before the strangers came."""
    growth_mb = max(memory_mb) - memory_mb[0]
    return RequirementResult(
        f"the server's memory grows by at most {MAX_GROWTH_MB:.0f} MB",
        f"{memory_mb[0]:.0f} MB before, {max(memory_mb):.0f} MB at most, {memory_mb[-1]:.0f} at "
        "the end",
        growth_mb <= MAX_GROWTH_MB,
    )


def evaluate_reference_client(log: ReferenceClientLog) -> list[RequirementResult]:
    """Judge what a guest saw: its cycle, and its frames."""
    periods = [later - earlier for earlier, later in pairwise(log.status_s)]
    mean_s = statistics.fmean(periods) if periods else float("inf")
    late = sum(p > (1.0 + PERIOD_TOLERANCE) * REPORT_PERIOD_S for p in periods) / max(
        1, len(periods)
    )
    return [
        RequirementResult(
            "a client that behaves keeps its 0.2 s cycle: the mean within 20 %, 19 of 20 too",
            f"mean {mean_s:.3f} s of {len(periods)}, {late:.1%} are longer than 0.24 s",
            abs(mean_s - REPORT_PERIOD_S) <= PERIOD_TOLERANCE * REPORT_PERIOD_S and late <= 0.05,
        ),
        RequirementResult(
            "its frames come whole and in order on both transports, its answers to it alone",
            f"{log.tcp_frames} over TCP, {log.stream_frames} over the stream, "
            f"{len(log.faults)} faults {log.faults[:2]}",
            min(log.tcp_frames, log.stream_frames) >= 10 and not log.faults,
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
