"""Memory of a process, and of a call."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path


def resident_mb(pid: int) -> float:
    """Resident size of a running process in MB, from /proc."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert found is not None, "/proc has no resident size of this process"
    return int(found[1]) / 1024.0


def peak_bytes(call: Callable[[], object]) -> int:
    """Most memory that Python and NumPy held at once during a call, beyond that before."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
