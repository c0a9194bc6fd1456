"""What many seeds say together: medians, quantiles, and the paper's claims as numbers to check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from catoptra_client.experiment.replay import (
    Trace,
    acceptance_share,
    first_acceptance_after_drought,
)

# The paper counts steps from 1; row 0 of a trace is the start. The robot reaches the first corner
# at the end of step 23; steps 85 to 100 are the diagonal.
_DIAGONAL = slice(85, 101)
_FIRST_STEPS = slice(1, 6)


@dataclass(frozen=True, slots=True)
class RunFigures:
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


def run_figures(trace: Trace) -> RunFigures:
    """Return the figures of one run."""
    estimate, odometry = trace.estimate_error_m, trace.odometry_error_m
    return RunFigures(
        seed=trace.seed,
        odometry_max_m=float(odometry.max()),
        odometry_steps_above_1m=int((odometry > 1.0).sum()),
        ekf_max_m=float(estimate.max()),
        ekf_mean_m=float(estimate[1:].mean()),
        ekf_mean_on_diagonal_m=float(estimate[_DIAGONAL].mean()),
        ekf_max_after_step_30_m=float(estimate[31:].max()),
        accepted_steps_1_to_8=acceptance_share(trace, 1, 8),
        accepted_steps_9_to_22=acceptance_share(trace, 9, 22),
        accepted_steps_23_to_40=acceptance_share(trace, 23, 40),
        accepted_steps_41_to_100=acceptance_share(trace, 41, 100),
        relock_step=first_acceptance_after_drought(trace),
        longest_rejection_streak=int(trace.streak.max()),
        windowed_nis_max=float(trace.windowed_nis.max()),
        ekf_worse_in_first_5_steps=bool(
            estimate[_FIRST_STEPS].mean() > odometry[_FIRST_STEPS].mean()
        ),
    )


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, mean, and the 5 % and 95 % quantiles over the `count` seeds that have a value."""

    median: float
    mean: float
    low: float
    high: float
    count: int


def spread(values: Sequence[float | int | bool | None]) -> Spread | None:
    """Return the spread of the values that are there; None if none is."""
    present = [float(value) for value in values if value is not None]
    if not present:
        return None
    low, median, high = np.quantile(present, [0.05, 0.5, 0.95])
    return Spread(float(median), float(np.mean(present)), float(low), float(high), len(present))


def summary(traces: Sequence[Trace]) -> dict[str, object]:
    """Return every run's figures and their spread, ready for JSON."""
    runs = [asdict(run_figures(trace)) for trace in traces]
    keys = [key for key in runs[0] if key != "seed"]
    spreads = {key: spread([run[key] for run in runs]) for key in keys}
    return {
        "seeds": [run["seed"] for run in runs],
        "spread": {key: asdict(value) if value else None for key, value in spreads.items()},
        "runs": runs,
    }


def error_bands(traces: Sequence[Trace], *, of_odometry: bool) -> np.ndarray[tuple[int, int]]:
    """Return the (3, steps + 1) 5 %, 50 % and 95 % quantiles of the position error in metres."""
    errors = [t.odometry_error_m if of_odometry else t.estimate_error_m for t in traces]
    bands: np.ndarray[tuple[int, int]] = np.quantile(np.array(errors), [0.05, 0.5, 0.95], axis=0)
    return bands


def typical(traces: Sequence[Trace]) -> int:
    """Return the index of the run whose largest error is the median one: the run to show."""
    order = np.argsort([trace.estimate_error_m.max() for trace in traces])
    return int(order[(len(order) - 1) // 2])
