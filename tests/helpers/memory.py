"""What a process takes of the machine's memory."""

from __future__ import annotations

import re
from pathlib import Path


def resident_mb(pid: int) -> float:
    """Return the resident size of a living process, in MB; Linux tells it."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert found is not None, "Linux tells the resident size of a living process"
    return int(found[1]) / 1024.0
