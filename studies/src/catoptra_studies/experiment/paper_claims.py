"""The paper's findings as claims that a run of the experiment confirms or not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catoptra_studies.experiment.experiment_report import Claim

_PAPER_ODOMETRY_ERROR_M = 1.0
_PAPER_EKF_ERROR_M = 0.6


def evaluate_claims(setups: Mapping[str, Any]) -> list[Claim]:
    """Return the claims with what was measured; `setups` as in summary.json."""
    claims = []
    for name, setup in setups.items():
        spread = setup["filters"]["paper"]["spread"]
        claims += [_odometry_claim(name, spread), _ekf_claim(name, spread)]
    if "real" in setups:
        paper = setups["real"]["filters"]["paper"]
        claims += _lock_out_claims(paper["spread"], len(paper["seeds"]))
    if "sim" in setups:
        claims += _early_acceptance_claims(setups["sim"]["filters"]["paper"]["spread"])
    return claims


def _median(statistics: Mapping[str, Any], key: str) -> float:
    value = statistics[key]
    return float("nan") if value is None else float(value["median"])


def _odometry_claim(name: str, statistics: Mapping[str, Any]) -> Claim:
    largest, steps = (
        _median(statistics, "odometry_max_m"),
        _median(statistics, "odometry_steps_above_1m"),
    )
    return Claim(
        f"{name}: odometry alone is wrong by more than 1 m at several steps",
        f"{largest:.2f} m at worst, {steps:.0f} steps above 1 m (median run)",
        largest > _PAPER_ODOMETRY_ERROR_M and steps >= 2,
    )


def _ekf_claim(name: str, statistics: Mapping[str, Any]) -> Claim:
    largest = _median(statistics, "ekf_max_m")
    return Claim(
        f"{name}: the filter stays within 0.6 m",
        f"{largest:.2f} m at worst (median run)",
        largest < _PAPER_EKF_ERROR_M,
    )


def _lock_out_claims(statistics: Mapping[str, Any], num_runs: int) -> list[Claim]:
    before, after = (
        _median(statistics, "accepted_steps_9_to_22"),
        _median(statistics, "accepted_steps_23_to_40"),
    )
    return [
        Claim(
            "real: with P0 = 0 the gate rejects most landmarks before the first corner",
            f"{before:.0%} accepted in steps 9 to 22, {after:.0%} in 23 to 40 (median run)",
            before < 0.5 < after,
        ),
        _relock_claim(statistics["relock_step"], num_runs),
    ]


def _relock_claim(relock_statistics: Mapping[str, Any] | None, num_runs: int) -> Claim:
    text = "real: where all were rejected, they pass again near step 23, where the corner widens P"
    if relock_statistics is None:
        return Claim(text, "no run was locked out for five steps", False)
    return Claim(
        text,
        f"step {relock_statistics['median']:.0f} (median of {relock_statistics['count']} of {num_runs} runs)",
        20 <= relock_statistics["median"] <= 26,
    )


def _early_acceptance_claims(statistics: Mapping[str, Any]) -> list[Claim]:
    worse = statistics["ekf_worse_in_first_5_steps"]["mean"]
    accepted = _median(statistics, "accepted_steps_1_to_8")
    return [
        Claim(
            "sim: landmarks pass the gate from the start",
            f"{accepted:.0%} accepted in steps 1 to 8 (median run)",
            accepted > 0.5,
        ),
        Claim(
            "sim: in the first five steps the filter is worse than odometry alone",
            f"in {worse:.0%} of the runs",
            worse > 0.5,
        ),
    ]
