"""The paper's findings as claims that a run of the experiment confirms or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from catoptra_studies.paper_values import PAPER_EKF_ERROR_M, PAPER_ODOMETRY_ERROR_M


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of the paper, compared with this run."""

    text: str

    measurement: str
    """The measured value as a phrase."""

    is_confirmed: bool


def evaluate_claims(setups: Mapping[str, Any]) -> list[Claim]:
    """Compare the paper's claims with a run.

    Args:
        setups: The entry `setups` of summary.json. Claims about a set-up that was not driven are
            left out.
    """
    claims = []
    for name, setup in setups.items():
        statistics = setup["filters"]["paper"]["statistics"]
        claims += [_odometry_claim(name, statistics), _ekf_claim(name, statistics)]
    if "real" in setups:
        paper = setups["real"]["filters"]["paper"]
        claims += _lock_out_claims(paper["statistics"], len(paper["seeds"]))
    if "sim" in setups:
        claims += _early_acceptance_claims(setups["sim"]["filters"]["paper"]["statistics"])
    return claims


def _median(statistics: Mapping[str, Any], key: str) -> float:
    # nan makes every comparison false, so a metric without values confirms nothing.
    value = statistics[key]
    return float("nan") if value is None else float(value["median"])


def _odometry_claim(name: str, statistics: Mapping[str, Any]) -> Claim:
    max_m = _median(statistics, "odometry_max_m")
    num_steps = _median(statistics, "odometry_steps_above_1m")
    return Claim(
        f"{name}: odometry alone is wrong by more than 1 m at several steps",
        f"{max_m:.2f} m at worst, {num_steps:.0f} steps above 1 m (median run)",
        max_m > PAPER_ODOMETRY_ERROR_M and num_steps >= 2,
    )


def _ekf_claim(name: str, statistics: Mapping[str, Any]) -> Claim:
    max_m = _median(statistics, "ekf_max_m")
    return Claim(
        f"{name}: the filter stays within 0.6 m",
        f"{max_m:.2f} m at worst (median run)",
        max_m < PAPER_EKF_ERROR_M,
    )


def _lock_out_claims(statistics: Mapping[str, Any], num_runs: int) -> list[Claim]:
    before = _median(statistics, "accepted_steps_9_to_22")
    after = _median(statistics, "accepted_steps_23_to_40")
    return [
        Claim(
            "real: with P0 = 0 the gate rejects most landmarks before the first corner",
            f"{before:.0%} accepted in steps 9 to 22, {after:.0%} in 23 to 40 (median run)",
            # Most: the acceptance rate crosses one half at the corner.
            before < 0.5 < after,
        ),
        _relock_claim(statistics["relock_step"], num_runs),
    ]


def _relock_claim(relock: Mapping[str, Any] | None, num_runs: int) -> Claim:
    text = "real: where all were rejected, they pass again near step 23, where the corner widens P"
    if relock is None:
        return Claim(text, "no run was locked out for five steps", False)
    return Claim(
        text,
        f"step {relock['median']:.0f} (median of {relock['count']} of {num_runs} runs)",
        # Three steps around the corner's first turn, since seeds differ in slip and detections.
        20 <= relock["median"] <= 26,
    )


def _early_acceptance_claims(statistics: Mapping[str, Any]) -> list[Claim]:
    fraction_worse = statistics["ekf_worse_in_first_5_steps"]["mean"]
    accepted = _median(statistics, "accepted_steps_1_to_8")
    return [
        Claim(
            "sim: landmarks pass the gate from the start",
            f"{accepted:.0%} accepted in steps 1 to 8 (median run)",
            accepted > 0.5,
        ),
        Claim(
            "sim: in the first five steps the filter is worse than odometry alone",
            f"in {fraction_worse:.0%} of the runs",
            fraction_worse > 0.5,
        ),
    ]
