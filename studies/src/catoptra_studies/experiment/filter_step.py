"""The experiment's filter, one step at a time: odometry, then every landmark. Pure functions.

A drive is followed while the robot drives, or replayed from its log, by the same functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
from catoptra_studies.experiment.drive_log import DriveStep
from catoptra_studies.experiment.experiment_setups import FilterSettings
from catoptra_studies.experiment.landmark_measurement import LandmarkMeasurement


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
    health = update_health(previous.health, updates)
    # With the defaults of the client library: after five rejecting steps 0.3 m and 10 degrees.
    if settings.has_recovery:
        belief, health = apply_recovery(belief, health, recovery=Recovery())
    # Odometry alone is the filter's own motion model without updates.
    odometry_pose = propagate_pose(previous.odometry_pose, control)
    return FilterStep(step, belief, health, odometry_pose, tuple(updates))


def _range_bearing(measurement: LandmarkMeasurement, settings: FilterSettings) -> RangeBearing:
    covariance = np.diag([settings.range_sigma_m**2, settings.bearing_sigma_rad**2])
    return RangeBearing(measurement.range_m, measurement.bearing_rad, covariance)
