"""A filter run over a logged drive: beliefs, accepted measurements, errors. Pure functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.localization import LandmarkMap
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.experiment.drive_log import DriveLog
from catoptra_studies.experiment.experiment_setups import ExperimentSetup, FilterSettings
from catoptra_studies.experiment.filter_step import FilterStep, advance_filter, begin_filter


@dataclass(frozen=True, slots=True, eq=False)
class FilterRun:
    """Results of a filter over one drive: a row for each step and the start, n together."""

    filter_name: str
    run: int

    estimate: Floats
    """(n, 3) estimated poses: metres, metres, radians."""

    odometry: Floats
    """(n, 3) poses by odometry alone, from the same believed start."""

    estimate_error_m: Floats
    """(n,) distances of the estimate from the truth."""

    odometry_error_m: Floats
    """(n,) distances of odometry from the truth."""

    num_measured: npt.NDArray[np.int64]
    """(n,) measured landmarks."""

    num_accepted: npt.NDArray[np.int64]
    """(n,) measurements that passed the validation gate."""

    rejection_streak: npt.NDArray[np.int64]
    """(n,) steps in a row that measured landmarks and accepted none."""

    windowed_nis: Floats
    """(n,) normalized innovation squared of the latest measurements, per degree of freedom; 1 is
    consistent."""


def replay_filter(
    drive_log: DriveLog, setup: ExperimentSetup, settings: FilterSettings, landmark_map: LandmarkMap
) -> FilterRun:
    """Run a filter over a logged drive.

    Args:
        drive_log: Drive to replay.
        setup: Set-up of the drive, for the error of the believed start.
        settings: Noises, gate and recovery of the filter.
        landmark_map: Positions of the landmarks by name.
    """
    start, *rest = drive_log.steps
    heading_error_rad = setup.initial_heading_error_rad
    filter_steps = [begin_filter(start, settings, heading_error_rad=heading_error_rad)]
    for step in rest:
        filter_steps.append(advance_filter(filter_steps[-1], step, settings, landmark_map))
    return summarize_filter_steps(filter_steps, settings, run=drive_log.run)


def summarize_filter_steps(
    filter_steps: Sequence[FilterStep], settings: FilterSettings, *, run: int
) -> FilterRun:
    """Results of a filter's steps over one whole drive.

    Args:
        filter_steps: States after all steps of the drive, the start first.
        settings: Filter of the steps.
        run: Number of the run.
    """
    truth = np.array([(s.drive_step.truth.x_m, s.drive_step.truth.y_m) for s in filter_steps])
    estimate = np.array([step.belief.mean for step in filter_steps])
    odometry = np.array([step.odometry_pose for step in filter_steps])
    return FilterRun(
        filter_name=settings.name,
        run=run,
        estimate=estimate,
        odometry=odometry,
        estimate_error_m=np.linalg.norm(estimate[:, :2] - truth, axis=1),
        odometry_error_m=np.linalg.norm(odometry[:, :2] - truth, axis=1),
        num_measured=np.array([len(step.updates) for step in filter_steps]),
        num_accepted=np.array(
            [sum(update.is_accepted for update in step.updates) for step in filter_steps]
        ),
        rejection_streak=np.array([step.health.rejection_streak for step in filter_steps]),
        windowed_nis=np.array([step.health.windowed_nis for step in filter_steps]),
    )


def find_relock_step(filter_run: FilterRun, *, min_rejecting_steps: int = 5) -> int | None:
    """First accepting step after a streak of rejecting ones; None where there is none.

    Args:
        filter_run: Results of a filter.
        min_rejecting_steps: Length of the streak. Steps without measurements do not count.
    """
    streak = 0
    for step, (num_measured, num_accepted) in enumerate(
        zip(filter_run.num_measured, filter_run.num_accepted, strict=True)
    ):
        if num_accepted and streak >= min_rejecting_steps:
            return step
        # Steps without measurements neither lengthen nor end a streak: the gate decided nothing.
        if num_measured:
            streak = 0 if num_accepted else streak + 1
    return None


def acceptance_rate(filter_run: FilterRun, first_step: int, last_step: int) -> float | None:
    """Fraction of the measurements accepted in a range of steps, both ends included.

    None where no landmark was measured.
    """
    steps = slice(first_step, last_step + 1)
    num_measured = int(filter_run.num_measured[steps].sum())
    return int(filter_run.num_accepted[steps].sum()) / num_measured if num_measured else None
