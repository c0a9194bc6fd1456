"""Hard cases of all formulas: a function of the product has the value of 50 digits, or rejects."""

from __future__ import annotations

import pytest

from stability.catalogue import Case, check, load
from stability.measuring import groups
from stability.mutations import subjects_of
from stability.subjects.mirror import IN_FLOAT32

CASES = [case for group in groups() for case in load(group)]
PROJECTIONS_IN_FLOAT32 = [case for case in load("mirror") if case.float_type == "float32"]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.group}-{case}")
def test_hard_case_holds(case: Case) -> None:
    check(case, subjects_of(case.group))


@pytest.mark.parametrize("case", PROJECTIONS_IN_FLOAT32, ids=str)
def test_projection_when_computed_in_float32_is_that_of_50_digits(case: Case) -> None:
    check(case, IN_FLOAT32)
