"""What a long run requires, what it measured, and whether that holds: as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class RequirementResult:
    """One requirement, what was measured, and whether it holds."""

    requirement: str
    measurement: str
    is_met: bool


def print_requirements(results: Sequence[RequirementResult], console: Console | None = None) -> int:
    """Print a table; return the exit status, 0 if every requirement holds."""
    table = Table("requirement", "measured", "holds")
    for verdict in results:
        table.add_row(verdict.requirement, verdict.measurement, "yes" if verdict.is_met else "NO")
    (console or Console()).print(table)
    return 0 if all(verdict.is_met for verdict in results) else 1
