"""The paper's findings as statements about a run, and how many runs of an experiment satisfy them.

The paper has one run of each set-up, so a finding of it is confirmed where the typical run shows
it, too: in more than half of the runs. The interval beside the share says how sure that is after so
many runs. What the typical run here does not show is no claim but a difference, with its own
statements in `paper_differences`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER
from catoptra_studies.experiment.run_share import RunShare, count_runs
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M, PAPER_SIM_EKF_ERROR_M

# Metrics of one run by the name of the filter, as in summary.json.
RunByFilter = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Statement:
    """A finding of the paper that a run shows or not."""

    key: str
    """Name in tables and files."""

    setup: str
    """Name of the set-up that it is about."""

    text: str

    criterion: str
    """The condition on a run, in numbers."""

    is_satisfied: Callable[[RunByFilter], bool]


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement, with the runs of one experiment that satisfy it."""

    key: str
    text: str
    criterion: str
    runs: RunShare

    @property
    def is_confirmed(self) -> bool:
        """Whether more than half of the runs satisfy the statement."""
        return self.runs.share > 0.5


def evaluate_claims(setups: Mapping[str, Any]) -> list[Claim]:
    """Count the runs that satisfy each of the paper's statements.

    Args:
        setups: The entry `setups` of summary.json. Statements about a set-up that was not driven
            are left out.
    """
    return evaluate_statements(STATEMENTS, setups)


def evaluate_statements(statements: Iterable[Statement], setups: Mapping[str, Any]) -> list[Claim]:
    """Count the runs that satisfy each statement; the same for statements that are no claims."""
    return [
        Claim(
            statement.key,
            f"{statement.setup}: {statement.text}",
            statement.criterion,
            count_runs(map(statement.is_satisfied, runs_by_filter(setups[statement.setup]))),
        )
        for statement in statements
        if statement.setup in setups
    ]


def runs_by_filter(setup: Mapping[str, Any]) -> list[RunByFilter]:
    """Metrics of all filters for each run of a set-up."""
    filters = setup["filters"]
    columns = [filters[name]["runs"] for name in filters]
    return [dict(zip(filters, runs, strict=True)) for runs in zip(*columns, strict=True)]


def _odometry_diverges(run: RunByFilter) -> bool:
    # "Several" timesteps: three at least.
    return bool(run[PAPER_FILTER.name]["odometry_steps_above_1m"] >= 3)


def _filter_stays_within_paper_bound(run: RunByFilter) -> bool:
    return bool(run[PAPER_FILTER.name]["ekf_max_m"] < PAPER_EKF_ERROR_M)


def _sim_filter_stays_within_paper_bound(run: RunByFilter) -> bool:
    return bool(run[PAPER_FILTER.name]["ekf_max_m"] < PAPER_SIM_EKF_ERROR_M)


def _zero_covariance_rejects_landmarks(run: RunByFilter) -> bool:
    zero, consistent = (
        run[settings.name]["accepted_steps_1_to_22"]
        for settings in (PAPER_FILTER, CONSISTENT_FILTER)
    )
    # Without measurements neither gate has decided anything.
    return zero is not None and consistent is not None and bool(zero < consistent)


def _error_falls_after_corner(run: RunByFilter) -> bool:
    metrics = run[PAPER_FILTER.name]
    # "Significantly lowers": to less than half.
    return bool(metrics["ekf_mean_steps_31_to_60_m"] < 0.5 * metrics["ekf_mean_steps_9_to_23_m"])


def _first_landmark_passes(run: RunByFilter) -> bool:
    return run[PAPER_FILTER.name]["accepts_first_measurements"] is True


def _filter_starts_worse(run: RunByFilter) -> bool:
    return run[PAPER_FILTER.name]["ekf_worse_in_first_5_steps"] is True


_ODOMETRY = "odometry alone is wrong by more than 1 m at several steps"
_ODOMETRY_CRITERION = "odometry's error exceeds 1 m in at least 3 steps"
_BOUND = f"the paper's filter is accurate within {PAPER_EKF_ERROR_M:g} m"
_BOUND_CRITERION = f"its largest error is below {PAPER_EKF_ERROR_M:g} m"

STATEMENTS = (
    Statement("sim_odometry", "sim", _ODOMETRY, _ODOMETRY_CRITERION, _odometry_diverges),
    Statement("real_odometry", "real", _ODOMETRY, _ODOMETRY_CRITERION, _odometry_diverges),
    Statement("sim_bound", "sim", _BOUND, _BOUND_CRITERION, _filter_stays_within_paper_bound),
    Statement("real_bound", "real", _BOUND, _BOUND_CRITERION, _filter_stays_within_paper_bound),
    Statement(
        "real_gate",
        "real",
        "with P0 = 0 the gate discards landmarks before the first corner",
        "of the landmarks of steps 1 to 22 it accepts fewer than the consistent filter, whose P0 "
        "admits the error of the start",
        _zero_covariance_rejects_landmarks,
    ),
    Statement(
        "real_recovery",
        "real",
        "after the first corner the error of the paper's filter falls significantly",
        "its mean error in steps 31 to 60 is less than half of that in steps 9 to 23",
        _error_falls_after_corner,
    ),
    Statement(
        "sim_gate",
        "sim",
        "landmarks pass the gate of the paper's filter instantly",
        "it accepts a landmark in the first step that measures one",
        _first_landmark_passes,
    ),
    Statement(
        "sim_start",
        "sim",
        "in the first five steps the paper's filter is worse than odometry alone",
        "its mean error in steps 1 to 5 is above that of odometry",
        _filter_starts_worse,
    ),
    Statement(
        "sim_whole_run",
        "sim",
        f"the paper's filter remains below {PAPER_SIM_EKF_ERROR_M:g} m over the whole run",
        f"its largest error is below {PAPER_SIM_EKF_ERROR_M:g} m",
        _sim_filter_stays_within_paper_bound,
    ),
)
