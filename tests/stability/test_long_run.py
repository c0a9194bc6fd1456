"""First steps of the long run; `python -m stability.long_run` runs a million."""

from __future__ import annotations

from stability.long_run import run


def test_covariance_after_thousands_of_exact_updates_is_one() -> None:
    outcome = run(10_000)
    assert outcome.largest_asymmetry == 0.0
    # Definite, not merely forgiven: a belief lets rounding of 1e-12 pass.
    assert outcome.smallest_eigenvalue > 1e-9
    assert outcome.refused == 0
