"""Requirements of a long run with the measured values, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class RequirementResult:
    """A requirement, and the measurement that decides whether it is met."""

    requirement: str
    """The requirement as a sentence."""
    measurement: str
    """Measured values, for the table."""
    is_met: bool
    """Whether the requirement holds."""


def print_requirements(results: Sequence[RequirementResult], console: Console | None = None) -> int:
    """Print the table; exit status 0 if every requirement holds."""
    table = Table("requirement", "measured", "holds")
    for result in results:
        table.add_row(result.requirement, result.measurement, "yes" if result.is_met else "NO")
    (console or Console()).print(table)
    return 0 if all(result.is_met for result in results) else 1
