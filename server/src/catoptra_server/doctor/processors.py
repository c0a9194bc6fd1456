"""Processors: how many the server may use, against how many threads it would start."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from catoptra_server.doctor.finding import Finding, ok, warning

# Version 2 of control groups, as container engines set them.
CPU_LIMIT_FILE = Path("/sys/fs/cgroup/cpu.max")


def check_processors(
    count: int | None = None, limit_file: Path = CPU_LIMIT_FILE
) -> Iterator[Finding]:
    """Yield the processors, and a warning where a limit leaves fewer than threads are started."""
    count = len(os.sched_getaffinity(0)) if count is None else count
    limit = read_cpu_limit(limit_file)
    if limit is not None and limit < count:
        threads = max(1, int(limit))
        yield warning(
            "threads",
            f"{count} processors are seen, {limit:g} may be used: trace starts {count} threads",
            remedy=f"--threads {threads}",
        )
    else:
        yield ok("threads", f"{count} processors")


def read_cpu_limit(file: Path) -> float | None:
    """Return how many processors' time a control group grants; None without a limit."""
    try:
        quota, period = file.read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return None
    return None if quota == "max" else int(quota) / int(period)
