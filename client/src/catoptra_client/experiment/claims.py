"""The paper's findings as claims that a run of the experiment confirms or not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catoptra_client.experiment.report import Claim

_ODOMETRY_M = 1.0
_EKF_M = 0.6


def paper_claims(setups: Mapping[str, Any]) -> list[Claim]:
    """Return the claims with what was measured; `setups` as in summary.json."""
    claims = []
    for name, setup in setups.items():
        spread = setup["filters"]["paper"]["spread"]
        claims += [_odometry_claim(name, spread), _ekf_claim(name, spread)]
    if "real" in setups:
        paper = setups["real"]["filters"]["paper"]
        claims += _lock_out_claims(paper["spread"], len(paper["seeds"]))
    if "sim" in setups:
        claims += _instant_lock_claims(setups["sim"]["filters"]["paper"]["spread"])
    return claims


def _median(spread: Mapping[str, Any], key: str) -> float:
    value = spread[key]
    return float("nan") if value is None else float(value["median"])


def _odometry_claim(name: str, spread: Mapping[str, Any]) -> Claim:
    largest, steps = _median(spread, "odometry_max_m"), _median(spread, "odometry_steps_above_1m")
    return Claim(
        f"{name}: odometry alone is wrong by more than 1 m at several steps",
        f"{largest:.2f} m at worst, {steps:.0f} steps above 1 m (median run)",
        largest > _ODOMETRY_M and steps >= 2,
    )


def _ekf_claim(name: str, spread: Mapping[str, Any]) -> Claim:
    largest = _median(spread, "ekf_max_m")
    return Claim(
        f"{name}: the filter stays within 0.6 m",
        f"{largest:.2f} m at worst (median run)",
        largest < _EKF_M,
    )


def _lock_out_claims(spread: Mapping[str, Any], runs: int) -> list[Claim]:
    before, after = (
        _median(spread, "accepted_steps_9_to_22"),
        _median(spread, "accepted_steps_23_to_40"),
    )
    return [
        Claim(
            "real: with P0 = 0 the gate rejects most landmarks before the first corner",
            f"{before:.0%} accepted in steps 9 to 22, {after:.0%} in 23 to 40 (median run)",
            before < 0.5 < after,
        ),
        _relock_claim(spread["relock_step"], runs),
    ]


def _relock_claim(relock: Mapping[str, Any] | None, runs: int) -> Claim:
    text = "real: where all were rejected, they pass again near step 23, where the corner widens P"
    if relock is None:
        return Claim(text, "no run was locked out for five steps", False)
    return Claim(
        text,
        f"step {relock['median']:.0f} (median of {relock['count']} of {runs} runs)",
        20 <= relock["median"] <= 26,
    )


def _instant_lock_claims(spread: Mapping[str, Any]) -> list[Claim]:
    worse = spread["ekf_worse_in_first_5_steps"]["mean"]
    accepted = _median(spread, "accepted_steps_1_to_8")
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
