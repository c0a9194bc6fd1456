"""Findings of checks: a fact, or a problem with its remedy; the worst sets the exit status."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from enum import Enum

from catoptra_protocol.slotted_dataclass import dataclass


class Level(Enum):
    """Severity: with a warning the server can start, with a fault not."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check, printed as one line."""

    level: Level
    """Severity."""
    topic: str
    """Subject, such as `packages` or `raster on device 0`."""
    message: str
    """The observed state, or the problem."""
    remedy: str = ""
    """A command or an action that solves the problem; empty for a fact."""

    def as_dict(self) -> dict[str, str]:
        """Values for JSON."""
        return asdict(self) | {"level": self.level.value}

    def __str__(self) -> str:
        line = f"{self.level.value:<8} {self.topic}: {self.message}"
        return f"{line}. Remedy: {self.remedy}" if self.remedy else line


def finding_from_dict(data: dict[str, str]) -> Finding:
    """Finding from the values of `as_dict`."""
    return Finding(Level(data["level"]), data["topic"], data["message"], data["remedy"])


def ok(topic: str, message: str) -> Finding:
    """A fact."""
    return Finding(Level.OK, topic, message)


def warning(topic: str, message: str, *, remedy: str) -> Finding:
    """A problem with which the server can start."""
    return Finding(Level.WARNING, topic, message, remedy)


def fault(topic: str, message: str, *, remedy: str) -> Finding:
    """A problem that keeps the server from starting."""
    return Finding(Level.FAULT, topic, message, remedy)


def exit_status(findings: Iterable[Finding]) -> int:
    """Exit status of the doctor: 2 with a fault, 1 with a warning, else 0."""
    levels = {finding.level for finding in findings}
    return 2 if Level.FAULT in levels else 1 if Level.WARNING in levels else 0
