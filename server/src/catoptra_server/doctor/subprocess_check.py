"""Checks in a process of their own, so that a crash there does not end the doctor.

A driver may crash, hang or print to stdout; a library may fail to load. The result is the last line
on stdout, a JSON object. `doctor/__main__` is the child's side.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

from catoptra_protocol.slotted_dataclass import dataclass

# The slowest check, a self-test on two busy processors, takes some seconds.
TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Outcome of a check."""

    values: dict[str, Any] = field(default_factory=dict)
    """The printed object; empty after an error."""
    error: str = ""
    """Reason for the lack of a result, as a clause of a message; empty if there is a result."""


def run_in_subprocess(*arguments: str, environment: Mapping[str, str] | None = None) -> CheckResult:
    """Run `python -m catoptra_server.doctor` with these arguments.

    Args:
        arguments: name of the check, and its own arguments.
        environment: variables in addition to those of this process.
    """
    command = [sys.executable, "-m", "catoptra_server.doctor", *arguments]
    return run_command(command, environment={**os.environ, **(environment or {})})


def run_command(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    timeout_s: float = TIMEOUT_S,
) -> CheckResult:
    """Run a command that prints its result; a failure of any kind becomes CheckResult.error."""
    try:
        process = subprocess.run(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            # Drivers print in encodings of their own.
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return CheckResult(error=f"no result within {timeout_s:g} s")
    # A negative status is the signal that ended the process, SIGSEGV for most broken drivers.
    if process.returncode < 0:
        return CheckResult(error=f"crashed ({_signal_name(-process.returncode)})")
    # The last line of a traceback names the exception; `main` prints the reason alone.
    if process.returncode > 0:
        return CheckResult(error=_last_line(process.stderr) or f"exit status {process.returncode}")
    return _parse_result(_last_line(process.stdout))


def _parse_result(line: str) -> CheckResult:
    try:
        values = json.loads(line)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        return CheckResult(error=f"the output is no JSON object: {line[:80]!r}")
    return CheckResult(values)


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no names
        return f"signal {number}"
