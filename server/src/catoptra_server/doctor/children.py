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
PATIENCE_S = 60.0


@dataclass(frozen=True, slots=True)
class Answer:
    """What a process said, or what became of it instead, as a clause for a message."""

    facts: dict[str, Any] = field(default_factory=dict)
    trouble: str = ""


def ask(*words: str, environment: Mapping[str, str] | None = None) -> Answer:
    """Return the answer of `python -m catoptra_server.doctor` to a question."""
    command = [sys.executable, "-m", "catoptra_server.doctor", *words]
    return answer_of(command, environment={**os.environ, **(environment or {})})


def answer_of(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    patience_s: float = PATIENCE_S,
) -> Answer:
    """Return what a command answers."""
    try:
        ran = subprocess.run(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Answer(trouble=f"it did not end within {patience_s:g} s")
    if ran.returncode < 0:
        return Answer(trouble=f"it crashed ({_signal_name(-ran.returncode)})")
    if ran.returncode > 0:
        return Answer(trouble=_last_line(ran.stderr) or f"it ended with {ran.returncode}")
    return _parsed(_last_line(ran.stdout))


def _parsed(line: str) -> Answer:
    try:
        facts = json.loads(line)
    except ValueError:
        facts = None
    if not isinstance(facts, dict):
        return Answer(trouble=f"it said nothing that can be read: {line[:80]!r}")
    return Answer(facts)


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no names
        return f"signal {number}"
