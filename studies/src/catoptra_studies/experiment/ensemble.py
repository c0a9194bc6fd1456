"""Statistics over many runs: metrics of each run, medians and quantiles over all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from catoptra_studies.experiment.filter_replay import (
    FilterRun,
    acceptance_rate,
    find_relock_step,
)
from catoptra_studies.paper_values import PAPER_ODOMETRY_ERROR_M

# The paper counts steps from 1, and row 0 of a run is the start, so its step k is row k. The robot
# reaches the first corner at the end of step 23; steps 85 to 100 are the diagonal.
_DIAGONAL_STEPS = slice(85, 101)
_FIRST_STEPS = slice(1, 6)


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """Metrics of one run; acceptance rates are None where no landmark was measured."""

    run: int
    odometry_max_m: float
    odometry_steps_above_1m: int
    ekf_max_m: float

    ekf_mean_m: float
    """Mean position error over the steps, without the start."""

    ekf_mean_steps_9_to_23_m: float
    """Mean error along the first side, from the first landmarks to the corner."""

    ekf_mean_steps_31_to_60_m: float
    """Mean error after the re-lock, along the second side and the third."""

    ekf_max_steps_61_to_84_m: float
    """Largest error on the way back to the start, where the paper reports a second growth."""

    ekf_mean_on_diagonal_m: float

    accepts_first_measurements: bool | None
    """Whether the gate accepts a landmark in the first step that measures one."""

    accepted_steps_1_to_22: float | None
    """Acceptance rate before the first corner."""

    accepted_steps_9_to_22: float | None
    """Acceptance rate along the first side, up to the corner."""

    accepted_steps_23_to_40: float | None
    accepted_steps_41_to_100: float | None

    relock_step: int | None
    """First accepting step after five that rejected all; None without such a streak."""

    longest_rejection_streak: int
    windowed_nis_max: float

    fewest_landmarks_in_a_step: int
    """Smallest number of landmarks measured in any step after the start."""

    ekf_worse_in_first_5_steps: bool
    """Whether the filter's mean error exceeds that of odometry in steps 1 to 5."""


def compute_run_metrics(filter_run: FilterRun) -> RunMetrics:
    """Compute the metrics of one run."""
    estimate_m, odometry_m = filter_run.estimate_error_m, filter_run.odometry_error_m
    return RunMetrics(
        run=filter_run.run,
        odometry_max_m=float(odometry_m.max()),
        odometry_steps_above_1m=int((odometry_m > PAPER_ODOMETRY_ERROR_M).sum()),
        ekf_max_m=float(estimate_m.max()),
        # The start is given and would only dilute the mean.
        ekf_mean_m=float(estimate_m[1:].mean()),
        ekf_mean_steps_9_to_23_m=float(estimate_m[9:24].mean()),
        ekf_mean_steps_31_to_60_m=float(estimate_m[31:61].mean()),
        ekf_max_steps_61_to_84_m=float(estimate_m[61:85].max()),
        ekf_mean_on_diagonal_m=float(estimate_m[_DIAGONAL_STEPS].mean()),
        accepts_first_measurements=_accepts_first_measurements(filter_run),
        accepted_steps_1_to_22=acceptance_rate(filter_run, 1, 22),
        accepted_steps_9_to_22=acceptance_rate(filter_run, 9, 22),
        accepted_steps_23_to_40=acceptance_rate(filter_run, 23, 40),
        accepted_steps_41_to_100=acceptance_rate(filter_run, 41, 100),
        relock_step=find_relock_step(filter_run),
        longest_rejection_streak=int(filter_run.rejection_streak.max()),
        windowed_nis_max=float(filter_run.windowed_nis.max()),
        fewest_landmarks_in_a_step=int(filter_run.num_measured[1:].min()),
        ekf_worse_in_first_5_steps=bool(
            estimate_m[_FIRST_STEPS].mean() > odometry_m[_FIRST_STEPS].mean()
        ),
    )


def _accepts_first_measurements(filter_run: FilterRun) -> bool | None:
    """None where no landmark was measured in the whole run."""
    measuring_steps = np.flatnonzero(filter_run.num_measured)
    return bool(filter_run.num_accepted[measuring_steps[0]]) if len(measuring_steps) else None


@dataclass(frozen=True, slots=True)
class SummaryStatistics:
    """Statistics of one metric over the runs that have a value."""

    median: float
    mean: float

    p05: float
    """Quantile of 5 %."""

    p95: float
    """Quantile of 95 %."""

    count: int
    """Runs that have a value."""


def summary_statistics(values: Sequence[float | int | bool | None]) -> SummaryStatistics | None:
    """Statistics of the values that are not None; None where there is no value."""
    present = [float(value) for value in values if value is not None]
    if not present:
        return None
    p05, median, p95 = np.quantile(present, [0.05, 0.5, 0.95])
    return SummaryStatistics(
        float(median), float(np.mean(present)), float(p05), float(p95), len(present)
    )


def summarize_runs(filter_runs: Sequence[FilterRun]) -> dict[str, object]:
    """Metrics of every run and their statistics, as for JSON."""
    runs = [asdict(compute_run_metrics(filter_run)) for filter_run in filter_runs]
    keys = [key for key in runs[0] if key != "run"]
    statistics = {key: summary_statistics([run[key] for run in runs]) for key in keys}
    return {
        "statistics": {key: asdict(value) if value else None for key, value in statistics.items()},
        "runs": runs,
    }


def error_quantiles(
    filter_runs: Sequence[FilterRun], *, of_odometry: bool
) -> np.ndarray[tuple[int, int]]:
    """(3, steps + 1) quantiles of 5 %, 50 % and 95 % of the position error in metres."""
    errors_m = [
        run.odometry_error_m if of_odometry else run.estimate_error_m for run in filter_runs
    ]
    # Quantiles, since locked-out runs lie far from the others and would dominate a deviation.
    quantiles: np.ndarray[tuple[int, int]] = np.quantile(
        np.array(errors_m), [0.05, 0.5, 0.95], axis=0
    )
    return quantiles


def median_run_index(filter_runs: Sequence[FilterRun]) -> int:
    """Index of the run with the median of the largest errors: the run to show."""
    order = np.argsort([run.estimate_error_m.max() for run in filter_runs])
    # Of an even number of runs the lower median, since no run lies between both.
    return int(order[(len(order) - 1) // 2])
