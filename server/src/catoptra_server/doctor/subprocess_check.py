"""Questions that are asked in a process of their own: what crashes there does not end the doctor.

A driver may crash, hang or print; a library may not load. The answer is the last line on stdout, an
object in JSON.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

# The slowest, a self-test on two busy processors, takes some seconds.
TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What a process said, or what became of it instead, as a clause for a message."""

    values: dict[str, Any] = field(default_factory=dict)
    error: str = ""


def run_in_subprocess(*arguments: str, environment: Mapping[str, str] | None = None) -> CheckResult:
    """Return the answer of `python -m catoptra_server.doctor` to a question."""
    command = [sys.executable, "-m", "catoptra_server.doctor", *arguments]
    return run_command(command, environment={**os.environ, **(environment or {})})


def run_command(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    timeout_s: float = TIMEOUT_S,
) -> CheckResult:
    """Return what a command answers."""
    try:
        ran = subprocess.run(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return CheckResult(error=f"it did not end within {timeout_s:g} s")
    if ran.returncode < 0:
        return CheckResult(error=f"it crashed ({_signal_name(-ran.returncode)})")
    if ran.returncode > 0:
        return CheckResult(error=_last_line(ran.stderr) or f"it ended with {ran.returncode}")
    return _parse_result(_last_line(ran.stdout))


def _parse_result(line: str) -> CheckResult:
    try:
        facts = json.loads(line)
    except ValueError:
        facts = None
    if not isinstance(facts, dict):
        return CheckResult(error=f"it said nothing that can be read: {line[:80]!r}")
    return CheckResult(facts)


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no names
        return f"signal {number}"
