"""The paper's findings as statements about a run, and how many runs of an experiment satisfy them.

The paper has one run of each set-up, so a finding is confirmed where the typical run shows the
same: in more than half of all runs that there could be. The driven runs decide that only where the
interval of their share excludes one half. What the typical run does not show is no claim but a
difference, with numbers and the likely reason.

Claims are counted over runs, with 50 seeds by `make experiment-seeds`: medians of 20 runs decided
one by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    MAX_RANGE_M,
    PAPER_FILTER,
)
from catoptra_studies.paper_values import (
    PAPER_DIAGONAL_ERROR_M,
    PAPER_EKF_ERROR_M,
    PAPER_RELOCK_STEP,
    PAPER_SIM_EKF_ERROR_M,
)
from catoptra_studies.run_statistics import RunShare

# Metrics of one run of a filter, as in summary.json.
_Run = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class _Statement:
    """A finding of the paper that a run shows or not."""

    key: str
    """Name in tables and files."""

    setup: str
    """Name of the set-up in question."""

    text: str

    criterion: str
    """The condition on a run, in numbers."""

    is_satisfied: Callable[[_Run, _Run], bool]
    """Condition on one drive's runs of the paper's filter and of the consistent one."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement, with the satisfying runs of one experiment."""

    key: str
    text: str
    criterion: str
    runs: RunShare

    @property
    def is_confirmed(self) -> bool:
        """Whether the interval of the satisfying runs lies above one half."""
        return self.runs.interval[0] > 0.5

    @property
    def is_refuted(self) -> bool:
        """Whether the interval lies below one half."""
        return self.runs.interval[1] < 0.5

    @property
    def verdict(self) -> str:
        """yes, no, or that so few runs do not decide."""
        if self.is_confirmed:
            return "yes"
        return "no" if self.is_refuted else f"not decided in {self.runs.num_runs} runs"


def _odometry_diverges(paper: _Run, _: _Run) -> bool:
    # "Several" timesteps: three at least.
    return bool(paper["odometry_steps_above_1m"] >= 3)


def _stays_within(bound_m: float) -> Callable[[_Run, _Run], bool]:
    return lambda paper, _: paper["ekf_max_m"] < bound_m


def _zero_covariance_rejects_landmarks(paper: _Run, consistent: _Run) -> bool:
    zero, other = (run["accepted_steps_1_to_22"] for run in (paper, consistent))
    # Without measurements neither gate has decided anything.
    return zero is not None and other is not None and bool(zero < other)


_ODOMETRY = "odometry alone is wrong by more than 1 m at several steps"
_ODOMETRY_CRITERION = "odometry's error exceeds 1 m in at least 3 steps"
_BOUND = f"the paper's filter is accurate within {PAPER_EKF_ERROR_M:g} m"
_BOUND_CRITERION = f"its largest error is below {PAPER_EKF_ERROR_M:g} m"

STATEMENTS = (
    _Statement("sim_odometry", "sim", _ODOMETRY, _ODOMETRY_CRITERION, _odometry_diverges),
    _Statement("real_odometry", "real", _ODOMETRY, _ODOMETRY_CRITERION, _odometry_diverges),
    _Statement("sim_bound", "sim", _BOUND, _BOUND_CRITERION, _stays_within(PAPER_EKF_ERROR_M)),
    _Statement("real_bound", "real", _BOUND, _BOUND_CRITERION, _stays_within(PAPER_EKF_ERROR_M)),
    _Statement(
        "real_gate",
        "real",
        "with P0 = 0 the gate discards landmarks before the first corner",
        "of the landmarks of steps 1 to 22 it accepts fewer than the consistent filter, whose P0 "
        "admits the error of the start",
        _zero_covariance_rejects_landmarks,
    ),
    _Statement(
        "real_recovery",
        "real",
        "after the first corner the error of the paper's filter falls significantly",
        "its mean error in steps 31 to 60 is less than half of that in steps 9 to 23",
        # "Significantly lowers": to less than half.
        lambda paper, _: (
            paper["ekf_mean_steps_31_to_60_m"] < 0.5 * paper["ekf_mean_steps_9_to_23_m"]
        ),
    ),
    _Statement(
        "sim_gate",
        "sim",
        "landmarks pass the gate of the paper's filter instantly",
        "it accepts a landmark in the first step that measures one",
        lambda paper, _: paper["accepts_first_measurements"] is True,
    ),
    _Statement(
        "sim_start",
        "sim",
        "in the first five steps the paper's filter is worse than odometry alone",
        "its mean error in steps 1 to 5 is above that of odometry",
        lambda paper, _: paper["ekf_worse_in_first_5_steps"] is True,
    ),
    _Statement(
        "sim_whole_run",
        "sim",
        f"the paper's filter remains below {PAPER_SIM_EKF_ERROR_M:g} m over the whole run",
        f"its largest error is below {PAPER_SIM_EKF_ERROR_M:g} m",
        _stays_within(PAPER_SIM_EKF_ERROR_M),
    ),
)


def evaluate_claims(
    setups: Mapping[str, Any], statements: Iterable[_Statement] = STATEMENTS
) -> list[Claim]:
    """Count the runs that satisfy each statement.

    Args:
        setups: The entry `setups` of summary.json. Statements about a set-up that was not driven
            are left out.
        statements: The paper's claims, or statements that are none.
    """
    return [
        Claim(
            statement.key,
            f"{statement.setup}: {statement.text}",
            statement.criterion,
            _count_runs(statement, setups[statement.setup]["filters"]),
        )
        for statement in statements
        if statement.setup in setups
    ]


def _count_runs(statement: _Statement, filters: Mapping[str, Any]) -> RunShare:
    runs = (filters[settings.name]["runs"] for settings in (PAPER_FILTER, CONSISTENT_FILTER))
    truths = [statement.is_satisfied(*pair) for pair in zip(*runs, strict=True)]
    return RunShare(sum(truths), len(truths))


# Half of the paper's bound: a growth that a reader of Figure 13 would see.
_VISIBLE_ERROR_M = 0.5 * PAPER_EKF_ERROR_M


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between the paper's results and an experiment's."""

    paper: str
    """The paper's finding."""

    here: str
    """The corresponding numbers of this experiment."""

    reason: str
    """The likely reason, as far as known."""


def list_differences(setups: Mapping[str, Any]) -> list[Difference]:
    """Differences from the paper, with numbers of the set-ups that were driven.

    Args:
        setups: The entry `setups` of summary.json.
    """
    shares = {claim.key: claim.runs for claim in evaluate_claims(setups, UNTYPICAL_STATEMENTS)}
    differences = []
    if "real" in setups:
        differences.append(_describe_lock_out(setups["real"], shares))
        differences.append(_describe_second_growth(setups["real"], shares))
    if "sim" in setups:
        differences.append(_describe_diagonal(setups["sim"]))
    if "sim" in setups and "real" in setups:
        differences.append(_describe_landmark_accuracy(setups["sim"], setups["real"]))
    return differences


# What the paper's run shows and the typical run here does not: counted, and no claims.
UNTYPICAL_STATEMENTS = (
    _Statement(
        "real_most_rejected",
        "real",
        "the gate rejects most landmarks before the first corner",
        "it accepts less than half of the landmarks of steps 9 to 22",
        lambda paper, _: (
            paper["accepted_steps_9_to_22"] is not None and paper["accepted_steps_9_to_22"] < 0.5
        ),
    ),
    _Statement(
        "real_all_rejected",
        "real",
        "the gate rejects all landmarks for a while, and then they pass again",
        "five steps or more that measured landmarks and accepted none, then one that accepts",
        lambda paper, _: paper["relock_step"] is not None,
    ),
    _Statement(
        "real_second_growth",
        "real",
        "the filter's error grows a second time before the start is reached again",
        f"it exceeds {_VISIBLE_ERROR_M:g} m in steps 61 to 84",
        lambda paper, _: paper["ekf_max_steps_61_to_84_m"] > _VISIBLE_ERROR_M,
    ),
)


def _paper_filter(setup: Mapping[str, Any]) -> Mapping[str, Any]:
    entry: Mapping[str, Any] = setup["filters"][PAPER_FILTER.name]
    return entry


def _describe_lock_out(real: Mapping[str, Any], shares: Mapping[str, RunShare]) -> Difference:
    steps = [run["relock_step"] for run in _paper_filter(real)["runs"]]
    found = [step for step in steps if step is not None]
    # A range, since few runs would leave a median of two or three.
    when = f"; landmarks pass again in step {min(found)} to {max(found)}" if found else ""
    return Difference(
        "real: the gate discards the landmarks ahead until they pass in step "
        f"{PAPER_RELOCK_STEP}, at the first corner",
        f"it rejects more than half of the landmarks of steps 9 to 22 in "
        f"{shares['real_most_rejected']}, and all landmarks for five steps or more in "
        f"{shares['real_all_rejected']}{when}",
        "in the other runs landmarks near the limit of the gate happen to pass first and correct "
        "the heading, after which all pass. The paper has one run and cannot show both kinds",
    )


def _describe_second_growth(real: Mapping[str, Any], shares: Mapping[str, RunShare]) -> Difference:
    entry = _paper_filter(real)
    largest = entry["statistics"]["ekf_max_steps_61_to_84_m"]
    fewest = min(run["fewest_landmarks_in_a_step"] for run in entry["runs"])
    return Difference(
        "real: the filter's error grows a second time on the way back to the lower left corner, "
        "and falls after step 80",
        f"{largest['median']:.2f} m at most in steps 61 to 84 (median run); above "
        f"{_VISIBLE_ERROR_M:g} m in {shares['real_second_growth']}",
        "the paper's robot had not enough observations of landmarks there; here all within "
        f"{MAX_RANGE_M:g} m are measured, {fewest} at least in every step",
    )


def _describe_diagonal(sim: Mapping[str, Any]) -> Difference:
    mean = _paper_filter(sim)["statistics"]["ekf_mean_on_diagonal_m"]
    ratio = PAPER_DIAGONAL_ERROR_M / mean["median"]
    return Difference(
        "sim: on the diagonal the estimate describes a parallel path, "
        f"{PAPER_DIAGONAL_ERROR_M:g} m off on average",
        f"{mean['median']:.3f} m (median run; 5 % to 95 % of the runs: {mean['p05']:.3f} to "
        f"{mean['p95']:.3f} m), {ratio:.0f} times less, and no parallel path",
        "a constant offset needs a constant error, such as a wrong height of the viewpoint, a "
        "wrong scale of Eq. 2, or landmarks that are misplaced on the map. Here the client has the "
        "rendered mirror's own camera model and the world's own map",
    )


def _describe_landmark_accuracy(sim: Mapping[str, Any], real: Mapping[str, Any]) -> Difference:
    return Difference(
        "landmarks located by the classifier (sim) are less accurate than those by hand (real)",
        "the classifier's are more accurate: range and bearing are wrong by "
        f"{_format_rms(sim)} (rms), by hand by {_format_rms(real)}",
        "the accuracy by hand is an assumption of this experiment, and the classifier has frames "
        "without noise, the exact camera model, and centroids of many pixels",
    )


def _format_rms(setup: Mapping[str, Any]) -> str:
    range_m = setup["measurements"]["range_error_m"].get("rms")
    bearing_deg = setup["measurements"]["bearing_error_deg"].get("rms")
    # Without measurements the quantiles are empty.
    if range_m is None or bearing_deg is None:
        return "nothing, as none was measured"
    return f"{1e3 * range_m:.0f} mm and {bearing_deg:.2f}°"
