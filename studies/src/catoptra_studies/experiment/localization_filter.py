"""The experiment's filter over a drive: steps, results, and a note for viewers.

A drive is followed while the robot drives, or replayed from its log, by the same functions: first
odometry, then every landmark. All are pure. The note shows a belief to the viewers of the robot,
such as the live page; SPEC.md 9.7 lists the keys that viewers draw.

The paper's filter follows the drive, so that viewers of `demo` see its belief; its run is not
replayed, which makes up for the time of the notes. The others are replayed from the log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.localization import (
    Belief,
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
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.experiment_setups import ExperimentSetup, FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class FilterStep:
    """State of a filter after one step of a drive."""

    drive_step: DriveStep

    belief: Belief
    """Belief after all measurements of the step."""

    health: FilterHealth

    odometry_pose: Floats
    """(3,) pose by odometry alone, from the same believed start: metres, metres, radians."""

    updates: tuple[MeasurementUpdate, ...]
    """One for each measurement of the step, in their order."""


def begin_filter(
    start: DriveStep, settings: FilterSettings, *, heading_error_rad: float
) -> FilterStep:
    """The true start with a heading error, and P0 of the filter.

    Args:
        start: First step of the drive.
        settings: Standard deviations of the start.
        heading_error_rad: Error of the believed heading, clockwise.
    """
    truth = start.truth
    # The heading error goes into the mean and never into P0: a filter that starts too certain.
    mean = np.array([truth.x_m, truth.y_m, truth.yaw_rad + heading_error_rad])
    position, heading = settings.initial_sigma_m**2, settings.initial_sigma_rad**2
    belief = Belief(mean, np.diag([position, position, heading]))
    return FilterStep(start, belief, FilterHealth(), belief.mean, ())


def advance_filter(
    previous: FilterStep, step: DriveStep, settings: FilterSettings, landmark_map: LandmarkMap
) -> FilterStep:
    """Predict, update by every measurement, then by the filter's health.

    Args:
        previous: State after the step before.
        step: Odometry and measurements.
        settings: Noises, gate and recovery of the filter.
        landmark_map: Positions of the landmarks by name.
    """
    control = control_from_odometry(previous.drive_step.odometry, step.odometry)
    belief = predict(previous.belief, control, noise=settings.motion_noise)
    updates: list[MeasurementUpdate] = []
    covariance = np.diag([settings.range_sigma_m**2, settings.bearing_sigma_rad**2])
    # One landmark after the other, as in the paper: each gate has the belief of the last update.
    for measurement in step.measurements:
        measured = RangeBearing(measurement.range_m, measurement.bearing_rad, covariance)
        landmark = find_landmark_position(landmark_map, measurement.name)
        updates.append(update(belief, measured, landmark=landmark, gate=settings.gate))
        belief = updates[-1].belief
    health = update_health(previous.health, updates)
    # With the defaults of the client library: after five rejecting steps 0.3 m and 10 degrees.
    if settings.has_recovery:
        belief, health = apply_recovery(belief, health, recovery=Recovery())
    # Odometry alone is the filter's own motion model without updates.
    odometry_pose = propagate_pose(previous.odometry_pose, control)
    return FilterStep(step, belief, health, odometry_pose, tuple(updates))


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


NOTE_NAME = "ekf"


def note_from_filter_step(step: FilterStep) -> dict[str, object]:
    """Belief, detections and a line of text: metres, radians, the world frame."""
    measurements = zip(step.drive_step.measurements, step.updates, strict=True)
    return {
        **belief_entries(step.belief),
        "detections": [
            {
                "landmark": measurement.name,
                "bearing_rad": measurement.bearing_rad,
                "range_m": measurement.range_m,
                "accepted": update.is_accepted,
            }
            for measurement, update in measurements
        ],
        "text": _describe_filter_step(step),
    }


def belief_entries(belief: Belief) -> dict[str, object]:
    """Entries of a note about a belief alone."""
    return {"pose": belief.mean, "covariance": belief.covariance.ravel()}


def _describe_filter_step(step: FilterStep) -> str:
    """Error of the belief, standard deviations, and the decisions of the gate."""
    truth, mean = step.drive_step.truth, step.belief.mean
    error_m = math.hypot(mean[0] - truth.x_m, mean[1] - truth.y_m)
    sigma_x, sigma_y, sigma_yaw = np.sqrt(np.diagonal(step.belief.covariance))
    num_accepted = sum(update.is_accepted for update in step.updates)
    return (
        f"{error_m:.2f} m from the truth, σ {math.hypot(sigma_x, sigma_y):.2f} m and "
        f"{math.degrees(sigma_yaw):.1f}°; the gate accepts {num_accepted} of "
        f"{len(step.updates)} landmarks"
    )
