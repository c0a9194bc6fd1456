"""Requirements of the live page with the measured values: asserted, printed, written as a table."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from helpers.requirement_results import RequirementResult


@dataclass(slots=True)
class MeasuredRequirements:
    """All requirements of a run."""

    results: list[RequirementResult] = field(default_factory=list)

    def check(self, requirement: str, measurement: str, *, is_met: bool) -> None:
        """Record a requirement with its measurement, and fail the test where it is not met."""
        self.results.append(RequirementResult(requirement, measurement, is_met))
        assert is_met, f"{requirement}: {measurement}"

    def write(self, path: Path, browser: str) -> str:
        """Write the table; its text.

        Args:
            path: Receives the table.
            browser: Name and version of the browser.
        """
        rows = [("requirement", "measured", "holds")]
        rows += [(r.requirement, r.measurement, "yes" if r.is_met else "NO") for r in self.results]
        lines = [f"| {' | '.join(row)} |" for row in rows]
        lines.insert(1, "|---|---|---|")
        text = "\n".join([f"{browser}, SwiftShader", "", *lines]) + "\n"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return text
