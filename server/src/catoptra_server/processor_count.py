"""Number of processors that this process may use."""

from __future__ import annotations

import os


def count_processors() -> int:
    """Processors of the affinity mask, or of the machine where the system has no such mask.

    The mask, since containers and tests restrict a process to fewer processors than there are.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
