"""The report: every group is in it, a failing case is told, nothing is loaded from elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from stability import measuring
from stability.consistency import consistency
from stability.measuring import groups, outcomes
from stability.report import page


def test_groups_are_all_that_have_cases() -> None:
    assert groups() == sorted(path.name for path in measuring.CASES.iterdir())


def test_page_has_every_group_and_needs_no_network() -> None:
    of_group = {group: outcomes(group) for group in ("cube", "wire")}
    text = page(of_group, [], consistency())
    assert "<b>cube</b>" in text
    assert "<summary>wire" in text
    assert "NEES, expected 3" in text
    assert "http" not in text
    assert "$" not in text


def test_outcome_when_a_number_is_off_says_by_how_much_of_what_is_allowed() -> None:
    first = next(o for o in outcomes("mirror") if o.case.expect == "value" and o.allowed > 0.0)
    wrong = replace(first.case, reference=str(2.0 * float(first.reference) + 1.0))
    outcome = measuring.measured(wrong, measuring.subjects_of("mirror"))
    assert outcome.share > 1e3
    assert outcome.error == pytest.approx(float(wrong.reference) - float(first.got))


def test_outcome_when_a_refusal_was_expected_and_a_value_came_is_a_failure() -> None:
    first = next(o for o in outcomes("mirror") if o.case.expect == "value")
    case = replace(first.case, expect="error")
    outcome = measuring.measured(case, measuring.subjects_of("mirror"))
    assert outcome.share == math.inf
