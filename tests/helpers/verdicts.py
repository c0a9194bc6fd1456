"""What a long run requires, what it measured, and whether that holds: as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class Verdict:
    """One requirement, what was measured, and whether it holds."""

    requirement: str
    measured: str
    holds: bool


def print_verdicts(verdicts: Sequence[Verdict], console: Console | None = None) -> int:
    """Print a table; return the exit status, 0 if every requirement holds."""
    table = Table("requirement", "measured", "holds")
    for verdict in verdicts:
        table.add_row(verdict.requirement, verdict.measured, "yes" if verdict.holds else "NO")
    (console or Console()).print(table)
    return 0 if all(verdict.holds for verdict in verdicts) else 1
