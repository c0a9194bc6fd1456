"""Check of processors: the number of threads against the limit of a control group."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from catoptra_server.doctor.finding import Finding, ok, warning
from catoptra_server.runtime.memory import count_processors

# cgroup v2, by which container engines limit processor time. The affinity mask, which gives trace
# the number of its threads, does not show this limit.
CPU_LIMIT_FILE = Path("/sys/fs/cgroup/cpu.max")


def check_processors(
    count: int | None = None, limit_file: Path = CPU_LIMIT_FILE
) -> Iterator[Finding]:
    """Yield the number of processors, or a warning where more threads than processors would run.

    Args:
        count: processors of the affinity mask; None = of this process.
        limit_file: cpu.max of the control group.
    """
    count = count_processors() if count is None else count
    limit = read_cpu_limit(limit_file)
    if limit is not None and limit < count:
        threads = max(1, int(limit))
        yield warning(
            "threads",
            f"{count} processors, of which {limit:g} may be used: trace starts {count} threads",
            remedy=f"--threads {threads}",
        )
    else:
        yield ok("threads", f"{count} processors")


def read_cpu_limit(file: Path) -> float | None:
    """Processor seconds per second that a control group grants; None without a limit."""
    try:
        quota, period = file.read_text(encoding="ascii").split()
    # Absent outside containers and with cgroup v1: no limit is known then.
    except (OSError, ValueError):
        return None
    return None if quota == "max" else int(quota) / int(period)
