"""Fuzzing of a live server: malformed input on all ports, while a reference client is served.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_server --seconds 30 --seed 1`. Starts a
server; malformed clients send random and mutated bytes to its three ports, messages to the stream
too, and reconnect when disconnected. Meanwhile a reference client has a robot and requests its
frames over both transports, and must not be disturbed. Prints a table; exits with 0 if every
requirement holds. Messages of endless parts have a test of their own (SPEC.md 9.8).
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
# Of 0.2 s, for the mean and for 19 of 20 single periods.
PERIOD_TOLERANCE = 0.2
# Connections and buffers of the malformed clients, and the pools of the allocator.
MAX_GROWTH_MB = 64.0
_MEMORY_SAMPLE_PERIOD_S = 0.5
_WARM_UP_S = 2.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz a server and evaluate the requirements; exit status."""
    parser = argparse.ArgumentParser(description="Send malformed input to a live server.")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        results = fuzz_server(Path(folder), seconds=options.seconds, seed=options.seed)
    return print_requirements(results)


def fuzz_server(folder: Path, *, seconds: float, seed: int) -> list[RequirementResult]:
    """Start a server, fuzz it for a number of seconds, and evaluate server and reference client."""
    with start_server(folder, "--image-type", "GOOD") as server:
        reference = ReferenceClient(server)
        malformed = MalformedClients(server, seed)
        memory_mb = asyncio.run(_run_clients(server, reference, malformed, seconds))
        is_running, faults = server.process.poll() is None, _count_tracebacks(server)
        status = server.terminate() if is_running else server.process.returncode
        late_faults = _count_tracebacks(server) - faults
    return [
        RequirementResult(
            "the server runs, without a traceback in its log",
            f"{'running' if is_running else 'exited'}, {faults} tracebacks",
            is_running and not faults,
        ),
        RequirementResult(
            "the malformed clients reached the server",
            f"{malformed.num_connections} connections, {malformed.sent_bytes / 1e6:.1f} MB sent",
            malformed.num_connections >= 10 and malformed.sent_bytes > 100_000,
        ),
        evaluate_memory(memory_mb),
        *evaluate_reference_client(reference.log),
        RequirementResult(
            "terminated after all clients have disconnected, it exits without a traceback",
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
    """Run all clients; memory of the server over time, the first sample before malformed input."""
    tasks = [asyncio.create_task(task) for task in reference_client.client_tasks()]
    await asyncio.sleep(_WARM_UP_S)
    memory_mb = [resident_mb(server.process.pid)]
    tasks += [asyncio.create_task(task) for task in malformed_clients.client_tasks()]
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and server.process.poll() is None:
        await asyncio.sleep(_MEMORY_SAMPLE_PERIOD_S)
        if server.process.poll() is None:
            memory_mb.append(resident_mb(server.process.pid))
    for task in tasks:
        if task.done() and not task.cancelled():
            reference_client.log.faults.append(f"ended early: {task.exception()!r}")
    await _cancel_tasks(tasks)
    reference_client.close()
    malformed_clients.close()
    return memory_mb


async def _cancel_tasks(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel tasks until all have ended.

    Once is not enough: `asyncio.wait_for` of Python 3.11 loses a cancellation at the moment at
    which its own future completes, and these tasks would run for ever.
    """
    while pending := [task for task in tasks if not task.done()]:
        for task in pending:
            task.cancel()
        await asyncio.wait(pending, timeout=REPORT_PERIOD_S)
    await asyncio.gather(*tasks, return_exceptions=True)


def evaluate_memory(memory_mb: list[float]) -> RequirementResult:
    """Requirement on the growth after the first sample."""
    growth_mb = max(memory_mb) - memory_mb[0]
    return RequirementResult(
        f"the server's memory grows by at most {MAX_GROWTH_MB:.0f} MB",
        f"{memory_mb[0]:.0f} MB before, maximum {max(memory_mb):.0f} MB, {memory_mb[-1]:.0f} MB "
        "at the end",
        growth_mb <= MAX_GROWTH_MB,
    )


def evaluate_reference_client(log: ReferenceClientLog) -> list[RequirementResult]:
    """Requirements on the report cycle and on the frames."""
    periods = [later - earlier for earlier, later in pairwise(log.status_s)]
    mean_s = statistics.fmean(periods) if periods else float("inf")
    late = sum(p > (1.0 + PERIOD_TOLERANCE) * REPORT_PERIOD_S for p in periods) / max(
        1, len(periods)
    )
    return [
        RequirementResult(
            "the reference client's 0.2 s cycle: mean within 20 %, 19 of 20 periods too",
            f"mean {mean_s:.3f} s of {len(periods)}, {late:.1%} longer than 0.24 s",
            abs(mean_s - REPORT_PERIOD_S) <= PERIOD_TOLERANCE * REPORT_PERIOD_S and late <= 0.05,
        ),
        RequirementResult(
            "its frames are complete and in order on both transports",
            f"{log.tcp_frames} over TCP, {log.stream_frames} over the stream, "
            f"{len(log.faults)} faults {log.faults[:2]}",
            min(log.tcp_frames, log.stream_frames) >= 10 and not log.faults,
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
