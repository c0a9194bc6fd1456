"""Progress on standard error."""

from __future__ import annotations

import io

import pytest

from catoptra_server.datasets.dataset_run import ProgressReport, format_duration


class Clock:
    """Clock that a test sets."""

    now_s = 0.0

    def __call__(self) -> float:
        """Time."""
        return self.now_s


def test_line_has_counts_rate_and_remaining_time() -> None:
    clock, output = Clock(), io.StringIO()
    progress = ProgressReport("tour", 200, 40, output, clock)
    assert progress.describe() == "tour: 40 of 200 samples"
    for number in range(80):
        clock.now_s = 0.5 * (number + 1)
        progress.count_samples(1)
    assert progress.describe() == "tour: 120 of 200 samples, 2.0 a second, 40 s left"
    progress.uncount_samples(10)
    assert progress.describe().startswith("tour: 110 of 200")


def test_log_gets_a_line_seldom_and_one_at_the_end() -> None:
    clock, output = Clock(), io.StringIO()
    progress = ProgressReport("tour", 100, 0, output, clock)
    for number in range(100):
        clock.now_s = float(number)
        progress.count_samples(1)
    progress.finish()
    assert len(output.getvalue().splitlines()) == 4
    assert output.getvalue().endswith("left\n")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.4, "59 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 05 min")],
)
def test_duration_is_short(seconds: float, text: str) -> None:
    assert format_duration(seconds) == text
