"""What a check found: a fact, or a problem and its remedy; together they make the exit status."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import Enum


class Level(Enum):
    """How bad it is. A warning does not keep the server from serving; a fault does."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the doctor's: what it is about, what is so, and what to do if it is a problem."""

    level: Level
    topic: str
    message: str
    remedy: str = ""

    def as_dict(self) -> dict[str, str]:
        """Return the finding for JSON."""
        return asdict(self) | {"level": self.level.value}

    def __str__(self) -> str:
        line = f"{self.level.value:<8} {self.topic}: {self.message}"
        return f"{line}. Remedy: {self.remedy}" if self.remedy else line


def finding_from_dict(data: dict[str, str]) -> Finding:
    """Return the finding that `as_dict` was made of."""
    return Finding(Level(data["level"]), data["topic"], data["what"], data["remedy"])


def ok(topic: str, message: str) -> Finding:
    """Return a fact."""
    return Finding(Level.OK, topic, message)


def warning(topic: str, message: str, *, remedy: str) -> Finding:
    """Return a problem that the server can live with."""
    return Finding(Level.WARNING, topic, message, remedy)


def fault(topic: str, message: str, *, remedy: str) -> Finding:
    """Return a problem that keeps the server from serving as asked."""
    return Finding(Level.FAULT, topic, message, remedy)


def exit_status(findings: Iterable[Finding]) -> int:
    """Return 0 = all well, 1 = it serves, with warnings, 2 = it cannot serve as asked."""
    levels = {finding.level for finding in findings}
    return 2 if Level.FAULT in levels else 1 if Level.WARNING in levels else 0
