"""Report: contains every group, reports a failing case, loads nothing from elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from stability import measuring, report
from stability.consistency import consistency
from stability.measuring import evaluate_group
from stability.report import page


def test_page_has_every_group_and_needs_no_network() -> None:
    of_group = {group: evaluate_group(group) for group in ("cube", "wire")}
    text = page(of_group, [], consistency())
    assert "<b>cube</b>" in text
    assert "<summary>wire" in text
    assert "NEES, expected 3" in text
    assert "http" not in text
    assert "$" not in text


def test_page_when_named_gets_the_counts(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "page.md"
    path.write_text("<!-- stability: begin -->\nformer\n<!-- stability: end -->\n")
    monkeypatch.setattr(report, "groups", lambda: ["cube"])
    monkeypatch.setattr(report, "evaluate_mutants", list)
    assert report.main([str(tmp_path), "--page", str(path)]) == 0
    cases = [one for one in evaluate_group("cube") if one.case.float_type == "float64"]
    assert f"| hard cases in float64      | {len(cases):6} |" in path.read_text()
    assert "former" not in path.read_text()


def test_outcome_has_the_error_as_a_fraction_of_the_allowed_one() -> None:
    first = next(
        o for o in evaluate_group("mirror") if o.case.expect == "value" and o.allowed > 0.0
    )
    wrong = replace(first.case, reference=str(2.0 * float(first.reference) + 1.0))
    outcome = measuring.evaluate_case(wrong, measuring.subjects_of("mirror"))
    assert outcome.error_fraction > 1e3
    assert outcome.error == pytest.approx(float(wrong.reference) - float(first.got))


def test_outcome_of_a_value_instead_of_a_rejection_is_a_failure() -> None:
    first = next(o for o in evaluate_group("mirror") if o.case.expect == "value")
    case = replace(first.case, expect="error")
    outcome = measuring.evaluate_case(case, measuring.subjects_of("mirror"))
    assert outcome.error_fraction == math.inf
