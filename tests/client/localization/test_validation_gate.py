"""The validation gate's thresholds against the chi-square distribution."""

from __future__ import annotations

import math

import mpmath
import pytest

from catoptra_client.localization.ekf import OPEN_GATE, PAPER_GATE, ValidationGate
from catoptra_protocol.errors import DomainError


def test_paper_gate_for_two_numbers_is_9_21034() -> None:
    assert PAPER_GATE.threshold(2) == pytest.approx(9.21034, abs=5e-6)


def test_paper_gate_for_one_number_is_6_63490() -> None:
    assert PAPER_GATE.threshold(1) == pytest.approx(6.63490, abs=5e-6)


@pytest.mark.parametrize("rate", [1e-300, 1e-15, 0.01, 0.5])
def test_probability_above_the_threshold_for_one_dof_is_the_rejection_rate(rate: float) -> None:
    above = mpmath.erfc(mpmath.sqrt(mpmath.mpf(ValidationGate(rate).threshold(1)) / 2))
    assert float(above) == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize("size", [1, 2])
def test_open_gate_has_no_threshold(size: int) -> None:
    assert OPEN_GATE.threshold(size) == math.inf


@pytest.mark.parametrize("rate", [-0.1, 1.0, math.nan])
def test_rate_outside_its_interval_is_rejected(rate: float) -> None:
    with pytest.raises(DomainError, match="rejection rate"):
        ValidationGate(rate)


def test_other_sizes_are_rejected() -> None:
    with pytest.raises(DomainError, match="1 or 2"):
        PAPER_GATE.threshold(3)
