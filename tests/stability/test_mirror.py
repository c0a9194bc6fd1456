"""Mirror projections: image radius of an incidence angle, the inverse and the slope."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Case, Subject, check, load


def _subject(method: str, of: str, number: type[np.floating] = np.float64) -> Subject:
    """Method of a mirror with this k, called with one number of a float type."""

    def subject(k: float, **given: float) -> Floats:
        value: Floats = getattr(HyperbolicMirror(k, 0.2), method)(np.array(given[of], number))
        assert value.dtype == number
        return value

    return subject


SUBJECTS = {
    "radius_from_incidence": _subject("radius_ratio_from_t", "t"),
    "incidence_from_radius": _subject("t_from_radius_ratio", "ratio"),
    "magnification": _subject("radius_ratio_slope", "t"),
}
IN_FLOAT32 = {
    "radius_from_incidence": _subject("radius_ratio_from_t", "t", np.float32),
    "incidence_from_radius": _subject("t_from_radius_ratio", "ratio", np.float32),
    "magnification": _subject("radius_ratio_slope", "t", np.float32),
}


@pytest.mark.parametrize("case", load("mirror"), ids=str)
def test_projection_when_at_a_hard_case_is_that_of_50_digits(case: Case) -> None:
    check(case, SUBJECTS)


@pytest.mark.parametrize("case", [c for c in load("mirror") if c.float_type == "float32"], ids=str)
def test_projection_when_computed_in_float32_is_that_of_50_digits(case: Case) -> None:
    check(case, IN_FLOAT32)
