"""Memory, descriptors and threads of the server's process over time."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from helpers.memory import resident_mb


@dataclass(frozen=True, slots=True)
class ProcessSample:
    """The process at one moment."""

    time_s: float
    """By the monotonic clock."""
    resident_mb: float
    descriptors: float
    threads: float


def sample_process(pid: int) -> ProcessSample:
    """Sample a process.

    Raises:
        OSError, AssertionError: The process has ended.
    """
    folder = Path(f"/proc/{pid}")
    descriptors = sum(1 for _ in (folder / "fd").iterdir())
    threads = sum(1 for _ in (folder / "task").iterdir())
    return ProcessSample(time.monotonic(), resident_mb(pid), descriptors, threads)


@asynccontextmanager
async def collect_samples(pid: int, *, interval_s: float) -> AsyncIterator[list[ProcessSample]]:
    """Sample a process at an interval for the length of a block, or until the process ends."""
    samples: list[ProcessSample] = []

    async def collect() -> None:
        while True:
            try:
                samples.append(sample_process(pid))
            except (OSError, AssertionError):
                return
            await asyncio.sleep(interval_s)

    task = asyncio.create_task(collect())
    try:
        yield samples
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
