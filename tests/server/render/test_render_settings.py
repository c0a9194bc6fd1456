"""Accuracy targets of a camera."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.render.renderer import AccuracyTarget, RenderSettings


def test_accuracy_target_by_default_is_not_set() -> None:
    assert not RenderSettings().accuracy_target.is_set
    assert AccuracyTarget(max_error_px=0.5).is_set
    assert AccuracyTarget(budget_ms=20.0).is_set


@pytest.mark.parametrize("value", [-0.1, math.inf, math.nan])
def test_accuracy_target_when_invalid_raises_with_the_name(value: float) -> None:
    with pytest.raises(DomainError, match="max_error_px must be 0"):
        AccuracyTarget(max_error_px=value)
    with pytest.raises(DomainError, match="budget_ms must be 0"):
        AccuracyTarget(budget_ms=value)


def test_accuracy_target_when_changed_keeps_the_other_value() -> None:
    target = AccuracyTarget(0.5, 20.0)
    assert target.with_changes(max_error_px=0.1, budget_ms=None) == AccuracyTarget(0.1, 20.0)
    assert target.with_changes(max_error_px=None, budget_ms=0.0) == AccuracyTarget(0.5, 0.0)
