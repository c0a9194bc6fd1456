"""Parts of a run that its growth is measured by."""

from __future__ import annotations

import pytest

from load.intervals import Phase
from load.soak import settled_phase


@pytest.mark.parametrize(
    ("length_s", "begin_s", "end_s"), [(600.0, 60.0, 120.0), (90.0, 54.0, 63.0), (9.0, 5.4, 6.3)]
)
def test_settled_phase_begins_after_a_minute_or_late_in_a_short_run(
    length_s: float, begin_s: float, end_s: float
) -> None:
    settled = settled_phase(Phase(1000.0, 1000.0 + length_s))
    assert settled.begin_s == pytest.approx(1000.0 + begin_s)
    assert settled.end_s == pytest.approx(1000.0 + end_s)
    assert settled.end_s <= 1000.0 + 0.75 * length_s, (
        "growth until the last quarter would be missed"
    )
