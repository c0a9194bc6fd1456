"""Hard cases of angles: ends of the interval, the seam, many turns, full precision near zero."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics import numerics
from stability.catalogue import Case, Subject, check, load

SUBJECTS: dict[str, Subject] = {
    "wrap": lambda angle: numerics.wrap_angle(angle),
    "difference": lambda angle, start: numerics.angle_difference(angle, start),
    "between": lambda start, end, fraction: numerics.interpolate_angle(
        start, end, fraction=fraction
    ),
}


@pytest.mark.parametrize("case", load("angles"), ids=str)
def test_hard_case_of_angles_holds(case: Case) -> None:
    check(case, SUBJECTS)
