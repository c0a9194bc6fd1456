"""A filter run over a recorded drive: beliefs, acceptances, errors. Pure functions."""

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
from catoptra_studies.experiment.drive_log import (
    DriveLog,
    DriveStep,
    LandmarkMeasurement,
    true_positions,
)
from catoptra_studies.experiment.experiment_setups import ExperimentSetup, FilterSettings

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FilterRun:
    """What came of a drive: one row a step, the start included.

    estimate, odometry: (n, 3) poses. estimate_error_m, odometry_error_m: (n,) distances from the
    truth. seen, accepted: (n,) numbers of landmarks. streak: (n,) rejecting steps in a row.
    windowed_nis: (n,) of the latest compared measurements, per degree of freedom; 1 is healthy.
    """

    filter_name: str
    seed: int
    estimate: Floats
    odometry: Floats
    estimate_error_m: Floats
    odometry_error_m: Floats
    num_measured: npt.NDArray[np.int64]
    num_accepted: npt.NDArray[np.int64]
    rejection_streak: npt.NDArray[np.int64]
    windowed_nis: Floats


def replay_filter(
    drive_log: DriveLog, setup: ExperimentSetup, settings: FilterSettings, landmark_map: LandmarkMap
) -> FilterRun:
    """Return the trace of a filter over a recording."""
    state = _FilterState(_initial_belief(drive_log, setup, settings), FilterHealth())
    odometry = [state.belief.mean]
    estimates, counts, health = [state.belief.mean], [(0, 0)], [state.health]
    for previous, step in zip(drive_log.steps, drive_log.steps[1:], strict=False):
        control = control_from_odometry(previous.odometry, step.odometry)
        odometry.append(propagate_pose(odometry[-1], control))
        state, updates = _filter_step(state, control, step, settings, landmark_map)
        estimates.append(state.belief.mean)
        counts.append((len(updates), sum(update.is_accepted for update in updates)))
        health.append(state.health)
    truth = true_positions(drive_log)
    seen, accepted = np.array(counts).T
    return FilterRun(
        filter_name=settings.name,
        seed=drive_log.seed,
        estimate=np.array(estimates),
        odometry=np.array(odometry),
        estimate_error_m=np.linalg.norm(np.array(estimates)[:, :2] - truth, axis=1),
        odometry_error_m=np.linalg.norm(np.array(odometry)[:, :2] - truth, axis=1),
        num_measured=seen,
        num_accepted=accepted,
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
    """Return the believed start: the true place with the set-up's heading error, and P0."""
    truth = drive_log.steps[0].truth
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
    """Predict, take in every landmark that was seen, look after the filter's health."""
    belief = predict(state.belief, control, noise=settings.motion_noise)
    updates: list[MeasurementUpdate] = []
    for seen in step.measurements:
        updates.append(
            update(
                belief,
                _range_bearing(seen, settings),
                landmark=find_landmark_position(landmark_map, seen.name),
                gate=settings.gate,
            )
        )
        belief = updates[-1].belief
    health = update_health(state.health, updates)
    if settings.has_recovery:
        belief, health = apply_recovery(belief, health, recovery=Recovery())
    return _FilterState(belief, health), updates


def _range_bearing(measurement: LandmarkMeasurement, settings: FilterSettings) -> RangeBearing:
    covariance = np.diag([settings.range_sigma_m**2, settings.bearing_sigma_rad**2])
    return RangeBearing(measurement.range_m, measurement.bearing_rad, covariance)


def find_relock_step(filter_run: FilterRun, *, min_rejecting_steps: int = 5) -> int | None:
    """Return the first accepting step after so many seeing steps without; None if none."""
    streak = 0
    for step, (seen, accepted) in enumerate(
        zip(filter_run.num_measured, filter_run.num_accepted, strict=True)
    ):
        if accepted and streak >= min_rejecting_steps:
            return step
        if seen:
            streak = 0 if accepted else streak + 1
    return None


def acceptance_rate(filter_run: FilterRun, first_step: int, last_step: int) -> float | None:
    """Return the share of seen landmarks that were accepted in steps first..last.

    None if no landmark was seen in them.
    """
    seen = int(filter_run.num_measured[first_step : last_step + 1].sum())
    return int(filter_run.num_accepted[first_step : last_step + 1].sum()) / seen if seen else None
