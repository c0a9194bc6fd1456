"""A filter run over a logged drive: beliefs, accepted measurements, errors. Pure functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.localization import (
    Belief,
    Control,
    FilterHealth,
    LandmarkMap,
    MeasurementUpdate,
    RangeBearing,
    Recovery,
    apply_recovery,
    control_from_odometry,
    find_landmark_position,
    predict,
    update,
    update_health,
)
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.experiment.drive_log import (
    DriveLog,
    DriveStep,
    LandmarkMeasurement,
    true_positions,
)
from catoptra_studies.experiment.experiment_setups import ExperimentSetup, FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class FilterRun:
    """Results of a filter over one drive: a row for each step and the start, n together."""

    filter_name: str
    seed: int

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
    state = _FilterState(_initial_belief(drive_log, setup, settings), FilterHealth())
    odometry = [state.belief.mean]
    estimates, counts, health = [state.belief.mean], [(0, 0)], [state.health]
    # Pairs of neighbours: the second sequence is one shorter.
    for previous, step in zip(drive_log.steps, drive_log.steps[1:], strict=False):
        control = control_from_odometry(previous.odometry, step.odometry)
        # Odometry alone is the filter's own motion model without updates.
        odometry.append(propagate_pose(odometry[-1], control))
        state, updates = _filter_step(state, control, step, settings, landmark_map)
        estimates.append(state.belief.mean)
        counts.append((len(updates), sum(update.is_accepted for update in updates)))
        health.append(state.health)
    truth = true_positions(drive_log)
    num_measured, num_accepted = np.array(counts).T
    return FilterRun(
        filter_name=settings.name,
        seed=drive_log.seed,
        estimate=np.array(estimates),
        odometry=np.array(odometry),
        estimate_error_m=np.linalg.norm(np.array(estimates)[:, :2] - truth, axis=1),
        odometry_error_m=np.linalg.norm(np.array(odometry)[:, :2] - truth, axis=1),
        num_measured=num_measured,
        num_accepted=num_accepted,
        rejection_streak=np.array([h.rejection_streak for h in health]),
        windowed_nis=np.array([h.windowed_nis for h in health]),
    )


@dataclass(frozen=True, slots=True)
class _FilterState:
    belief: Belief
    health: FilterHealth


def _initial_belief(
    drive_log: DriveLog, setup: ExperimentSetup, settings: FilterSettings
) -> Belief:
    """The true start with the set-up's heading error, and P0 of the filter."""
    truth = drive_log.steps[0].truth
    # The heading error goes into the mean and never into P0: a filter that starts too certain.
    mean = np.array([truth.x_m, truth.y_m, truth.yaw_rad + setup.initial_heading_error_rad])
    position, heading = settings.initial_sigma_m**2, settings.initial_sigma_rad**2
    return Belief(mean, np.diag([position, position, heading]))


def _filter_step(
    state: _FilterState,
    control: Control,
    step: DriveStep,
    settings: FilterSettings,
    landmark_map: LandmarkMap,
) -> tuple[_FilterState, list[MeasurementUpdate]]:
    """Predict, update by every measurement, then by the filter's health."""
    belief = predict(state.belief, control, noise=settings.motion_noise)
    updates: list[MeasurementUpdate] = []
    # One landmark after the other, as in the paper: each gate has the belief of the last update.
    for measurement in step.measurements:
        updates.append(
            update(
                belief,
                _range_bearing(measurement, settings),
                landmark=find_landmark_position(landmark_map, measurement.name),
                gate=settings.gate,
            )
        )
        belief = updates[-1].belief
    health = update_health(state.health, updates)
    # With the defaults of the client library: after five rejecting steps 0.3 m and 10 degrees.
    if settings.has_recovery:
        belief, health = apply_recovery(belief, health, recovery=Recovery())
    return _FilterState(belief, health), updates


def _range_bearing(measurement: LandmarkMeasurement, settings: FilterSettings) -> RangeBearing:
    covariance = np.diag([settings.range_sigma_m**2, settings.bearing_sigma_rad**2])
    return RangeBearing(measurement.range_m, measurement.bearing_rad, covariance)


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
