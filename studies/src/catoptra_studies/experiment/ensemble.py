"""What many seeds say together: medians, quantiles, and the paper's claims as numbers to check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from catoptra_studies.experiment.filter_replay import (
    FilterRun,
    acceptance_rate,
    find_relock_step,
)

# The paper counts steps from 1; row 0 of a trace is the start. The robot reaches the first corner
# at the end of step 23; steps 85 to 100 are the diagonal.
_DIAGONAL_STEPS = slice(85, 101)
_FIRST_STEPS = slice(1, 6)


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """The figures of one run. Shares are None where no landmark was seen."""

    seed: int
    odometry_max_m: float
    odometry_steps_above_1m: int
    ekf_max_m: float
    ekf_mean_m: float
    ekf_mean_on_diagonal_m: float
    ekf_max_after_step_30_m: float
    accepted_steps_1_to_8: float | None
    accepted_steps_9_to_22: float | None
    accepted_steps_23_to_40: float | None
    accepted_steps_41_to_100: float | None
    relock_step: int | None
    longest_rejection_streak: int
    windowed_nis_max: float
    ekf_worse_in_first_5_steps: bool


def compute_run_metrics(filter_run: FilterRun) -> RunMetrics:
    """Return the figures of one run."""
    estimate, odometry = filter_run.estimate_error_m, filter_run.odometry_error_m
    return RunMetrics(
        seed=filter_run.seed,
        odometry_max_m=float(odometry.max()),
        odometry_steps_above_1m=int((odometry > 1.0).sum()),
        ekf_max_m=float(estimate.max()),
        ekf_mean_m=float(estimate[1:].mean()),
        ekf_mean_on_diagonal_m=float(estimate[_DIAGONAL_STEPS].mean()),
        ekf_max_after_step_30_m=float(estimate[31:].max()),
        accepted_steps_1_to_8=acceptance_rate(filter_run, 1, 8),
        accepted_steps_9_to_22=acceptance_rate(filter_run, 9, 22),
        accepted_steps_23_to_40=acceptance_rate(filter_run, 23, 40),
        accepted_steps_41_to_100=acceptance_rate(filter_run, 41, 100),
        relock_step=find_relock_step(filter_run),
        longest_rejection_streak=int(filter_run.rejection_streak.max()),
        windowed_nis_max=float(filter_run.windowed_nis.max()),
        ekf_worse_in_first_5_steps=bool(
            estimate[_FIRST_STEPS].mean() > odometry[_FIRST_STEPS].mean()
        ),
    )


@dataclass(frozen=True, slots=True)
class SummaryStatistics:
    """Median, mean, and the 5 % and 95 % quantiles over the `count` seeds that have a value."""

    median: float
    mean: float
    p05: float
    p95: float
    count: int


def summary_statistics(values: Sequence[float | int | bool | None]) -> SummaryStatistics | None:
    """Return the spread of the values that are there; None if none is."""
    present = [float(value) for value in values if value is not None]
    if not present:
        return None
    low, median, high = np.quantile(present, [0.05, 0.5, 0.95])
    return SummaryStatistics(
        float(median), float(np.mean(present)), float(low), float(high), len(present)
    )


def summarise_runs(filter_runs: Sequence[FilterRun]) -> dict[str, object]:
    """Return every run's figures and their spread, ready for JSON."""
    runs = [asdict(compute_run_metrics(trace)) for trace in filter_runs]
    keys = [key for key in runs[0] if key != "seed"]
    spreads = {key: summary_statistics([run[key] for run in runs]) for key in keys}
    return {
        "seeds": [run["seed"] for run in runs],
        "spread": {key: asdict(value) if value else None for key, value in spreads.items()},
        "runs": runs,
    }


def error_quantiles(
    filter_runs: Sequence[FilterRun], *, of_odometry: bool
) -> np.ndarray[tuple[int, int]]:
    """Return the (3, steps + 1) 5 %, 50 % and 95 % quantiles of the position error in metres."""
    errors = [t.odometry_error_m if of_odometry else t.estimate_error_m for t in filter_runs]
    bands: np.ndarray[tuple[int, int]] = np.quantile(np.array(errors), [0.05, 0.5, 0.95], axis=0)
    return bands


def median_run_index(filter_runs: Sequence[FilterRun]) -> int:
    """Return the index of the run whose largest error is the median one: the run to show."""
    order = np.argsort([trace.estimate_error_m.max() for trace in filter_runs])
    return int(order[(len(order) - 1) // 2])
